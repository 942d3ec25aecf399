// The last minute as curves: distance from the path, lag, age of the pose.

import { element } from "./panels.js";

const SPAN_S = 60;
const SVG = "http://www.w3.org/2000/svg";
const input = (robot, name) => robot.inputs.find((one) => one.name === name);

// Each: what it says, its unit, its value in a report, its limit, and the least that is shown.
const CURVES = [
  { name: "distance from the path", unit: "cm", least: 5, signed: true,
    of: (robot) => robot.mission?.phase === "driving" ? 100 * robot.mission.offset_m : null },
  { name: "lag, from picture to wheels", unit: "ms", least: 100, of: (robot) => 1000 * robot.lag_s },
  { name: "pose age and limit", unit: "ms", least: 100,
    of: (robot) => { const age = input(robot, "pose")?.age_s ?? null; return age && 1000 * age; },
    limit: (robot) => 1000 * (input(robot, "pose")?.limit_s ?? 0) || null },
];

export class Minute {
  constructor(place) {
    this.live = [];
    this.rows = CURVES.map((curve) => {
      const svg = document.createElementNS(SVG, "svg");
      svg.setAttribute("preserveAspectRatio", "none");
      const lines = ["zero", "limit", "curve"].map((kind) => {
        const line = document.createElementNS(SVG, "path");
        line.setAttribute("class", kind);
        svg.append(line);
        return line;
      });
      const [scale, value] = [element("span"), element("b")];
      place.append(element("div", { className: "plot" },
        element("p", { className: "figures" }, element("span", {}, `${curve.name} `, scale), value), svg));
      return { ...curve, svg, lines, scale, value };
    });
  }

  // A report as it comes; one that came before is not taken twice.
  add(robot) {
    if (!robot || robot.sequence === this.live.at(-1)?.sequence) return;
    const now = performance.now() / 1000;
    this.live.push({ ...robot, t_s: now });
    while (this.live[0].t_s < now - SPAN_S) this.live.shift();
  }

  showLive() { this.show(this.live, performance.now() / 1000); }

  // The minute of reports, each with t_s, that ends at a time.
  show(reports, until) {
    const shown = reports.filter(({ t_s }) => t_s <= until && t_s >= until - SPAN_S);
    for (const row of this.rows) draw(row, shown, until);
  }
}

function draw({ svg, lines, scale, value, of, limit, unit, least, signed }, reports, until) {
  const values = reports.map(of);
  const known = values.filter((one) => one !== null);
  const stop = reports.length && limit ? limit(reports.at(-1)) : null;
  const most = Math.max(least, stop ?? 0, ...known.map(Math.abs)) * 1.1;
  svg.setAttribute("viewBox", `${-SPAN_S} ${-most} ${SPAN_S} ${signed ? 2 * most : most}`);
  scale.textContent = `(${signed ? "±" : "0–"}${Math.round(most)})`;
  const across = (y) => `M${-SPAN_S} ${-y}H0`;
  lines[0].setAttribute("d", across(0));
  lines[1].setAttribute("d", stop ? across(stop) : "");
  let pen = "M"; // lifted where there is no value
  lines[2].setAttribute("d", reports.map(({ t_s }, i) => {
    if (values[i] === null) { pen = "M"; return ""; }
    const point = `${pen}${(t_s - until).toFixed(2)} ${(-values[i]).toFixed(2)}`;
    pen = "L";
    return point;
  }).join(""));
  const last = values.at(-1) ?? null;
  const side = signed && last ? (last > 0 ? " left" : " right") : "";
  value.textContent = last === null ? "–"
    : `${Math.abs(last).toFixed(signed ? 1 : 0)} ${unit}${side}`;
}
