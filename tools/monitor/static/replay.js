// Past drives: a list, and one of them played again on the map, the camera and the panels.

import { $, actionName, element, seconds, toast } from "./panels.js";

const TICK_MS = 100;
const PICTURE_EVERY_S = 0.08;

export class Replay {
  // show(report, reports) draws a recorded report, look(blob or null) its picture; opened() and closed()
  // clear what was drawn.
  constructor({ show, look, opened, closed }) {
    Object.assign(this, { show, look, opened, closed });
    this.reports = null;
    $("replay-play").addEventListener("click", () => this.#play(!this.playing));
    $("replay-time").addEventListener("input", () => {
      this.#play(false);
      this.#seek(Number($("replay-time").value));
    });
    $("replay-close").addEventListener("click", () => this.close());
    for (const name of ["mark-good", "mark-bad"]) {
      $(name).addEventListener("click", () => this.#mark($(name).dataset.kind));
    }
    setInterval(() => this.#tick(), TICK_MS);
  }

  get on() { return this.reports !== null; }

  async list() {
    const drives = await (await fetch("/api/drives")).json();
    const rows = drives.map((drive) => {
      const button = element("button", { type: "button" },
        new Date(drive.began).toLocaleString([], { dateStyle: "medium", timeStyle: "short" }),
        element("span", { className: "quiet" }, `${drive.phase} · ${seconds(drive.duration_s)}`));
      button.addEventListener("click", () => this.open(drive));
      return element("li", {}, button);
    });
    const none = element("li", { className: "quiet" }, "No drives yet: each drive is recorded.");
    $("drives").replaceChildren(...(rows.length ? rows : [none]));
  }

  async open(drive) {
    const address = `/api/drives/${encodeURIComponent(drive.name)}`;
    const reports = await (await fetch(address)).json();
    if (!reports.length) return;
    const marks = await (await fetch(`${address}/marks`)).json();
    let path = [];
    for (const report of reports) {
      path = report.path.length ? report.path : path;
      report.path = path;
    }
    this.reports = reports;
    this.address = address;
    this.pictured = null;
    this.#begin(null);
    this.#marked(marks);
    this.opened();
    this.name = new Date(drive.began).toLocaleTimeString([], { timeStyle: "short" });
    $("replay-time").max = reports.at(-1).t_s;
    $("replay-states").replaceChildren(...this.#states());
    $("replay").hidden = false;
    $("hint").hidden = true;
    this.#seek(0);
    this.#play(true);
  }

  close() {
    this.reports = null;
    this.#play(false);
    $("replay").hidden = true;
    this.closed();
  }

  // A strip under the slider: one stretch for each state.
  #states() {
    const stretches = [];
    const end = this.reports.at(-1).t_s;
    this.reports.forEach(({ state, t_s }, i) => {
      const lasts = (this.reports[i + 1]?.t_s ?? end) - t_s;
      if (stretches.at(-1)?.state === state) stretches.at(-1).lasts += lasts;
      else stretches.push({ state, lasts });
    });
    return stretches.map(({ state, lasts }) => {
      const stretch = element("i", { title: state, "data-state": state });
      stretch.style.flexGrow = lasts;
      return stretch;
    });
  }

  // The first press begins a piece, the second ends it; one of the other kind begins anew.
  async #mark(kind) {
    const begun = this.begun;
    if (begun?.kind !== kind) { this.#begin({ kind, from_s: this.time }); return; }
    this.#begin(null);
    const [from_s, to_s] = [begun.from_s, this.time].sort((a, b) => a - b);
    if (to_s > from_s) await this.#save([...this.marks, { from_s, to_s, kind }]);
  }

  #begin(piece) {
    this.begun = piece;
    for (const name of ["mark-good", "mark-bad"]) {
      $(name).setAttribute("aria-pressed", String($(name).dataset.kind === piece?.kind));
    }
  }

  async #save(marks) {
    const answer = await fetch(`${this.address}/marks`, {
      method: "POST",
      headers: { "Content-Type": "application/json" },
      body: JSON.stringify(marks),
    }).then((response) => response.json()).catch((error) => ({ reason: error.message }));
    if (answer.accepted) this.#marked(marks);
    else toast(`the marks are not saved: ${answer.reason ?? answer.detail}`);
  }

  #marked(marks) {
    this.marks = marks;
    const end = this.reports.at(-1).t_s;
    $("replay-marks").replaceChildren(...marks.map((mark) => {
      const piece = element("i", { title: mark.kind, "data-kind": mark.kind });
      piece.style.left = `${100 * mark.from_s / end}%`;
      piece.style.width = `${100 * (mark.to_s - mark.from_s) / end}%`;
      piece.addEventListener("click", () => this.#save(this.marks.filter((one) => one !== mark)));
      return piece;
    }));
  }

  #play(on) {
    this.playing = on && this.on;
    $("replay-play").textContent = this.playing ? "Pause" : "Play";
    if (this.playing && this.time >= this.reports.at(-1).t_s) this.#seek(0);
  }

  #tick() {
    if (!this.playing) return;
    this.#seek(this.time + TICK_MS / 1000);
    if (this.time >= this.reports.at(-1).t_s) this.#play(false);
  }

  #seek(t) {
    this.time = t;
    const report = this.reports.findLast((one) => one.t_s <= t) ?? this.reports[0];
    const action = report.action === null ? "" : ` · ${actionName(report.actions, report.action)}`;
    $("replay-time").value = t;
    $("replay-text").textContent = `${this.name} · ${seconds(report.t_s)} · ${report.state}${action}`;
    this.show(report, this.reports);
    this.#picture();
  }

  // One request at a time, always for the newest moment.
  async #picture() {
    if (this.fetching) return;
    this.fetching = true;
    const { address } = this;
    while (this.on && this.address === address && this.pictured !== this.time) {
      const t = this.time;
      const answer = await fetch(`${address}/picture?t_s=${t + PICTURE_EVERY_S}`).catch(() => null);
      const blob = answer?.status === 200 ? await answer.blob() : null;
      if (!this.on || this.address !== address) break;
      this.pictured = t;
      await this.look(blob);
    }
    this.fetching = false;
  }
}
