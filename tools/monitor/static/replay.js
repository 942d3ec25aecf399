// Past drives: a list, and one of them played again on the map and the panels.

import { $, element, seconds } from "./panels.js";

const TICK_MS = 100;

export class Replay {
  // show(report) draws a recorded report; opened() and closed() clear what was drawn.
  constructor(show, opened, closed) {
    this.show = show;
    this.opened = opened;
    this.closed = closed;
    this.reports = null;
    $("replay-play").addEventListener("click", () => this.#play(!this.playing));
    $("replay-time").addEventListener("input", () => {
      this.#play(false);
      this.#seek(Number($("replay-time").value));
    });
    $("replay-close").addEventListener("click", () => this.close());
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
    const none = element("li", { className: "quiet" }, "No drives yet: a mission records one.");
    $("drives").replaceChildren(...(rows.length ? rows : [none]));
  }

  async open(drive) {
    const answer = await fetch(`/api/drives/${encodeURIComponent(drive.name)}`);
    const [, ...reports] = await answer.json();
    if (!reports.length) return;
    let path = [];
    let attention = null;
    for (const report of reports) {
      path = report.path.length ? report.path : path;
      attention = report.attention ?? attention;
      Object.assign(report, { path, attention });
    }
    this.reports = reports;
    this.opened();
    this.name = new Date(drive.began).toLocaleTimeString([], { timeStyle: "short" });
    $("replay-time").max = reports.at(-1).t_s;
    $("replay").hidden = false;
    this.#seek(0);
    this.#play(true);
  }

  close() {
    this.reports = null;
    this.#play(false);
    $("replay").hidden = true;
    this.closed();
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
    $("replay-time").value = t;
    $("replay-text").textContent = `Replay of ${this.name} · ${seconds(report.t_s)}`;
    this.show(report);
  }
}
