// Everything on the page but the map: state, camera, action, ages, health, log.

const ARROWS_DEG = [-68, -30, 0, 30, 68];
const ARROW_NAMES = ["left", "slight left", "straight", "slight right", "right"];
const SVG = "http://www.w3.org/2000/svg";

export const $ = (id) => document.getElementById(id);

export function element(tag, attributes = {}, ...children) {
  const made = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) {
    if (name.startsWith("data-")) made.setAttribute(name, value);
    else made[name] = value;
  }
  made.append(...children);
  return made;
}

function setText(node, text) {
  if (node.textContent !== text) node.textContent = text;
}

export function pressed(button, on) {
  button.setAttribute("aria-pressed", on);
}

export function seconds(s) {
  if (s === null || s === undefined) return "never";
  if (s < 1) return `${Math.round(1000 * s)} ms`;
  return s < 100 ? `${s.toFixed(1)} s` : `${Math.round(s)} s`;
}

export function showState(state, lost) {
  const robot = state?.robot;
  const silent = lost || !state || state.silent;
  const pill = $("state");
  pill.dataset.state = !robot ? "none" : silent ? "SILENT" : robot.state;
  setText(pill, !robot ? "no robot" : silent ? "SILENT" : robot.state);
  setText($("reason"), robot && !silent ? robot.reason : "");
  const alarm = alarmText(state, lost);
  $("alarm").hidden = !alarm;
  setText($("alarm"), alarm);
  $("arm").disabled = silent || !["DISARMED", "HOLD"].includes(robot?.state);
  $("disarm").disabled = silent || !robot || ["DISARMED", "FAULT"].includes(robot.state);
  $("clear").disabled = silent || robot?.state !== "FAULT";
  $("auto").hidden = !robot || (navigates(robot) && Boolean(robot.pose));
  $("auto").disabled = silent || !["READY", "MANUAL"].includes(robot?.state);
}

function alarmText(state, lost) {
  if (lost) return `This page has lost the monitor for ${seconds(lost)}. Trying again…`;
  if (!state?.silent) return "";
  if (state.silence_s === null) return "No robot heard yet.";
  return `The robot has been silent for ${seconds(state.silence_s)}; `
    + `last heard in ${state.robot.state}.`;
}

// A robot that keeps its lane needs no pose.
function navigates(robot) {
  return robot.inputs.some(({ name }) => name === "pose");
}

export function showMission(robot) {
  const mission = robot?.mission;
  if (robot && !mission && !navigates(robot)) {
    setText($("mission-text"), "This robot keeps its lane; it drives to no destination.");
    $("hint").hidden = true;
  }
  setText($("mission-phase"), mission ? mission.phase : "none");
  $("mission-bar").style.width = `${100 * (mission?.progress ?? 0)}%`;
  if (!mission) return;
  const [x, y] = mission.destination;
  const where = `to (${x.toFixed(2)}, ${y.toFixed(2)}) m`;
  setText($("mission-text"), mission.phase === "driving"
    ? `${where} · ${mission.remaining_m.toFixed(1)} m left · `
      + `${Math.round(100 * Math.abs(mission.offset_m))} cm off path`
    : `${where}${mission.reason ? ` · ${mission.reason}` : ""}`);
}

export function makeActions(pressed) {
  ARROWS_DEG.forEach((angle, action) => {
    const svg = document.createElementNS(SVG, "svg");
    svg.setAttribute("viewBox", "-12 -12 24 24");
    const arrow = document.createElementNS(SVG, "path");
    arrow.setAttribute("d", "M0 9V-9M-6-3 0-9 6-3");
    arrow.setAttribute("stroke-linecap", "round");
    arrow.setAttribute("stroke-linejoin", "round");
    arrow.setAttribute("transform", `rotate(${angle})`);
    svg.append(arrow);
    const button = element("button", { type: "button", title: ARROW_NAMES[action], disabled: true },
      svg, element("span", { className: "track" }, element("i")),
      element("span", { className: "value" }));
    const hold = (on) => (event) => { event.preventDefault(); pressed(on ? action : null); };
    button.addEventListener("pointerdown", hold(true));
    for (const end of ["pointerup", "pointercancel", "pointerleave"]) {
      button.addEventListener(end, hold(false));
    }
    button.addEventListener("contextmenu", (event) => event.preventDefault());
    $("actions").append(button);
  });
}

const turn = ([left, right]) => right - left;

// Whether a policy chooses among five actions from left to right, as the five buttons are.
function areTheFive(actions) {
  const turns = actions.map(turn);
  return turns.length === 5 && turns[2] === 0 && turns.every((one, i) => !i || one < turns[i - 1]);
}

export function actionName(actions, action) {
  if (!actions || areTheFive(actions)) return ARROW_NAMES[action];
  const [left, right] = actions[action];
  return left === 0 && right === 0 ? "stop" : `${left.toFixed(2)} | ${right.toFixed(2)} m/s`;
}

// What the policy makes of each action: beside the buttons, or in rows where it has others.
export function showAction(robot, fresh) {
  const others = robot?.actions && !areTheFive(robot.actions) ? robot.actions : [];
  const rows = $("own-actions");
  if (rows.children.length !== others.length) {
    rows.replaceChildren(...others.map(() => element("div", {},
      element("span", { className: "name" }), element("span", { className: "track" }, element("i")),
      element("span", { className: "value" }))));
  }
  others.forEach((_, i) => setText(rows.children[i].firstChild, actionName(others, i)));
  fillActions($("actions").children, others.length ? null : robot, fresh);
  fillActions(rows.children, robot, fresh);
}

function fillActions(places, robot, fresh) {
  const values = robot?.values ?? [];
  const [low, high] = [Math.min(...values), Math.max(...values)];
  [...places].forEach((place, action) => {
    place.classList.toggle("chosen", fresh && robot?.action === action);
    const value = values[action];
    const share = value === undefined || high === low ? 0 : (value - low) / (high - low);
    place.querySelector("i").style.width = `${100 * share}%`;
    setText(place.querySelector(".value"), value === undefined ? "" : value.toFixed(2));
  });
}

export function showRates(robot) {
  const parts = robot
    ? [`${robot.fps.toFixed(1)} decisions/s`, `${seconds(robot.lag_s)} lag`] : [];
  if (robot?.model) parts.push(robot.model);
  setText($("rates"), parts.join(" · "));
}

const TEXT_EVERY_MS = 400; // ages that flicker cannot be read

function ageText(age, limit) {
  if (age === null) return "never";
  if (age > Math.max(limit, 1)) return seconds(age);
  return limit < 1 ? `${Math.round(1000 * age)} / ${Math.round(1000 * limit)} ms`
    : `${age.toFixed(1)} / ${limit.toFixed(1)} s`;
}

// Green while well within the limit, amber when near it, red beyond it.
export function showAges(list, ages, added = 0) {
  const now = performance.now();
  const write = now - (Number(list.dataset.written) || -TEXT_EVERY_MS) >= TEXT_EVERY_MS;
  if (write) list.dataset.written = now;
  while (list.children.length > ages.length) list.lastChild.remove();
  ages.forEach(({ name, age_s, limit_s }, i) => {
    const row = list.children[i] ?? list.appendChild(element("div", { className: "age" },
      element("b"), element("span"), element("span")));
    const age = age_s === null ? null : age_s + added;
    const level = age === null || age > limit_s ? "bad" : age > 0.75 * limit_s ? "warn" : "ok";
    row.dataset.level = level;
    setText(row.children[1], name);
    if (write || !row.children[2].textContent) setText(row.children[2], ageText(age, limit_s));
  });
}

export function showHealth(readings) {
  $("health").replaceChildren(...readings.map(({ name, value, unit, level }) =>
    element("span", { "data-level": level }, `${name} ${Number(value.toFixed(2))} ${unit}`)));
}

export class Picture {
  constructor() {
    this.canvas = $("picture");
    this.bitmap = null;
    this.grid = null;
    $("attention").addEventListener("change", () => this.paint());
  }

  // A picture as a blob; null where there is none.
  async take(blob) {
    const bitmap = blob && await createImageBitmap(blob);
    this.bitmap?.close();
    this.bitmap = bitmap;
    this.paint();
  }

  show(attention, age_s, replay) {
    this.grid = attention ? overlay(attention) : null;
    const stale = replay ? !this.bitmap : age_s === null || age_s > 1;
    this.canvas.parentElement.classList.toggle("stale", stale);
    $("no-picture").hidden = !stale;
    setText($("no-picture"), replay ? "no picture was recorded"
      : age_s === null ? "no picture yet" : `no picture for ${seconds(age_s)}`);
    $("attention").parentElement.hidden = !attention;
  }

  paint() {
    const { canvas, bitmap } = this;
    if (!bitmap) { canvas.getContext("2d").clearRect(0, 0, canvas.width, canvas.height); return; }
    if (canvas.width !== bitmap.width || canvas.height !== bitmap.height) {
      [canvas.width, canvas.height] = [bitmap.width, bitmap.height];
    }
    const pen = canvas.getContext("2d");
    pen.drawImage(bitmap, 0, 0);
    if (this.grid && $("attention").checked) {
      pen.imageSmoothingEnabled = true;
      pen.drawImage(this.grid, 0, 0, canvas.width, canvas.height);
    }
  }
}

// One byte a cell, shown as warm light over the picture.
function overlay({ rows, columns, cells }) {
  const grid = new OffscreenCanvas(columns, rows);
  const image = new ImageData(columns, rows);
  [...atob(cells)].forEach((cell, i) => {
    const weight = cell.charCodeAt(0);
    image.data.set([255, 190 - weight / 3, 40, 0.62 * weight], 4 * i);
  });
  grid.getContext("2d").putImageData(image, 0, 0);
  return grid;
}

export function addLog(entries) {
  const list = $("log");
  for (const { t_unix_s, level, text } of entries) {
    const time = new Date(1000 * t_unix_s).toLocaleTimeString([], { hour12: false });
    list.prepend(element("li", { "data-level": level }, element("time", {}, time), text));
  }
  while (list.children.length > 200) list.lastChild.remove();
}

let toastTimer = 0;
export function toast(text) {
  $("toast").textContent = text;
  $("toast").hidden = false;
  clearTimeout(toastTimer);
  toastTimer = setTimeout(() => { $("toast").hidden = true; }, 6000);
}
