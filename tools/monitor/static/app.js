// The page: one WebSocket for what is, POST for what is asked.

import { Hand } from "./hand.js";
import { MapView } from "./map.js";
import { Minute } from "./minute.js";
import {
  $, Picture, addLog, makeActions, pressed, showAction, showAges, showHealth, showMission,
  showRates, showState, toast,
} from "./panels.js";
import { Replay } from "./replay.js";

const LOST_MS = 1000;
const RECONNECT_MS = 500;
const GIVE_UP_MS = 3000;
const OVERHEAD_SHOWN_S = 1;

let socket = null;
let state = null;
let heardAt = performance.now();
let triedAt = heardAt;
let logged = 0;
let unseen = 0; // states that came while nobody looked
let drives = -1;
let asking = false; // about a mission: the answer is shown on the map

const map = new MapView($("map"), choose);
const picture = new Picture();
const minute = new Minute($("plots"));
const hand = new Hand(
  (text) => { if (socket?.readyState === WebSocket.OPEN) socket.send(text); },
  () => state?.robot?.state,
);
const replay = new Replay({
  show: (report, reports) => { minute.show(reports, report.t_s); showRobot(report, true, true); },
  look: (blob) => picture.take(blob),
  opened: () => map.clearTrail(),
  closed: () => { map.clearTrail(); picture.take(null); if (state) showLive(); },
});

// What nobody sees keeps no robot driving: neither a page in the background, nor one that failed.
function tellSeen() {
  if (document.hidden || socket?.readyState !== WebSocket.OPEN) return;
  for (; unseen > 0; unseen--) socket.send("seen");
}

function connect() {
  triedAt = performance.now();
  unseen = 0;
  socket = new WebSocket(`${location.protocol === "https:" ? "wss" : "ws"}://${location.host}/ws`);
  socket.binaryType = "blob";
  socket.onmessage = ({ data }) => {
    heardAt = performance.now();
    if (data instanceof Blob) { if (!replay.on) picture.take(data); return; }
    take(JSON.parse(data));
    unseen++;
    tellSeen();
  };
  socket.onclose = () => setTimeout(connect, RECONNECT_MS);
}

function take({ state: newest, log }) {
  state = newest;
  const fresh = log.filter(({ number }) => number > logged);
  const firstTime = logged === 0;
  addLog(fresh);
  logged = log.length ? log.at(-1).number : logged;
  const refused = fresh.findLast(({ level }) => level === "refused");
  if (refused && !firstTime && !saidByTheMap(refused.text)) toast(refused.text);
  if (state.drives !== drives) { drives = state.drives; replay.list(); }
  showState(state, 0);
  showAges($("heard"), state.heard);
  minute.add(state.robot);
  if (!replay.on) { minute.showLive(); showLive(); }
}

function age(name) {
  return state.heard.find((input) => input.name === name)?.age_s ?? null;
}

function standing() {
  return ["DISARMED", "HOLD"].includes(state?.robot?.state);
}

function showLive() {
  showRobot(state.robot, !state.silent, false, age("picture"));
  $("hand-over").hidden = state.robot?.state !== "MANUAL" || !state.robot.mission;
  $("go").textContent = standing() ? "Arm and drive" : "Drive there";
}

function showRobot(robot, fresh, recorded, pictureAge = null) {
  const mission = robot?.mission;
  map.show({
    pose: robot?.pose ?? null,
    belief: robot?.belief ?? null,
    path: robot?.path ?? [],
    destination: mission?.destination,
    progress: mission?.progress,
    overhead: recorded || age("localizer") > OVERHEAD_SHOWN_S ? null : state.overhead,
    silent: !fresh,
  });
  picture.show(robot?.attention, pictureAge, recorded);
  showMission(robot);
  showAction(robot, fresh);
  showRates(robot);
  showAges($("inputs"), robot?.inputs ?? [], recorded ? 0 : state.silence_s ?? 0);
  showHealth(robot?.health ?? []);
}

function choose(chosen) {
  if (chosen.off) {
    forget();
    tell(`This ${chosen.off} is more than a tile from any lane. Choose a place on the road.`,
      chosen.clicked);
    return;
  }
  map.setChosen(chosen);
  tell("");
  const [x, y] = chosen.destination.map((value) => value.toFixed(2));
  const from = chosen.start ? `from (${chosen.start.map((v) => v.toFixed(2)).join(", ")}) ` : "";
  $("choice-text").textContent = `${from}to (${x}, ${y}) m`;
  $("choice").hidden = false;
  $("here").hidden = !chosen.start;
  $("hint").hidden = true;
}

function forget() {
  map.setChosen(null);
  tell("");
  $("choice").hidden = true;
}

// Why the robot does not go there, beside the place that was clicked.
function tell(problem, place = null) {
  map.refuse(place, problem);
  $("hint").hidden ||= !!problem;
}

// The answer and its line in the log come on two ways, in any order.
function saidByTheMap(text) {
  return asking || (!$("problem").hidden && text.endsWith($("problem").textContent));
}

async function command(kind) {
  const problem = await ask(kind);
  if (problem) toast(`${kind}: ${problem}`);
}

// Ask the robot; why not, or "".
async function ask(kind, more = {}) {
  try {
    const response = await fetch("/api/command", {
      method: "POST",
      headers: { "Content-Type": "application/json" },
      body: JSON.stringify({ kind, ...more }),
    });
    if (!response.ok) throw new Error(await response.text());
    const answer = await response.json();
    return answer.accepted ? "" : answer.reason || "refused";
  } catch (error) {
    return `the monitor does not answer: ${error.message}`;
  }
}

function stop() {
  hand.off();
  if (socket?.readyState === WebSocket.OPEN) socket.send("stop"); // a request may have to wait
  command("stop");
}

async function here() {
  const { start, destination } = map.chosen;
  const problem = await ask("place", { start, destination });
  if (problem) tell(problem, start);
  else forget();
}

async function go() {
  const { start, destination } = map.chosen;
  $("go").disabled = asking = true; // one press, one mission
  hand.rest();
  const problem = await ask("mission", { start, destination, arm: standing() });
  $("go").disabled = asking = false;
  $("toast").hidden = true;
  if (problem) {
    tell(problem, destination);
    return;
  }
  map.clearTrail();
  forget();
}

async function handOver() {
  hand.rest();
  const problem = await ask("mission", { destination: state.robot.mission.destination });
  if (problem) toast(problem);
}

function tab(name) {
  for (const other of ["log", "drives"]) {
    $(other).hidden = other !== name;
    $(`tab-${other}`).setAttribute("aria-selected", other === name);
  }
  if (name === "drives") replay.list();
}

function follow(on) {
  map.follow(on);
  for (const [name, chosen] of [["follow", on], ["whole", !on]]) pressed($(name), chosen);
}

// Dark by day or light by night, against what the computer says.
function theme() {
  const { style } = document.documentElement;
  const system = matchMedia("(prefers-color-scheme: dark)").matches ? "dark" : "light";
  style.colorScheme = (style.colorScheme || system) === "dark" ? "light" : "dark";
  map.redraw();
}

makeActions((action) => hand.press(action));
document.addEventListener("visibilitychange", tellSeen);
$("stop").addEventListener("pointerdown", stop); // a finger that slides or is the second never clicks
$("stop").addEventListener("click", stop);
addEventListener("keydown", (event) => {
  if (event.key !== " " && event.code !== "Space") return;
  event.preventDefault();
  if (!event.repeat) stop();
}, { capture: true });
addEventListener("keyup", (event) => {
  if (event.code === "Space") event.preventDefault(); // no click on the focused button
}, { capture: true });
for (const kind of ["arm", "auto", "disarm", "clear"]) {
  $(kind).addEventListener("click", () => command(kind));
}
$("go").addEventListener("click", go);
$("here").addEventListener("click", here);
$("forget").addEventListener("click", forget);
$("hand-over").addEventListener("click", handOver);
$("follow").addEventListener("click", () => follow(true));
$("whole").addEventListener("click", () => follow(false));
$("theme").addEventListener("click", theme);
matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => map.redraw());
$("tab-log").addEventListener("click", () => tab("log"));
$("tab-drives").addEventListener("click", () => tab("drives"));
setInterval(() => {
  const lost = performance.now() - heardAt;
  if (lost > LOST_MS) {
    showState(state, lost / 1000);
    if (state && !replay.on) showRobot(state.robot, false, false, lost / 1000);
    // A connection that the network swallowed is not told of its end for a long time.
    const long = Math.min(lost, performance.now() - triedAt) > GIVE_UP_MS;
    if (long && !document.hidden && socket.readyState <= WebSocket.OPEN) {
      socket.onclose = socket.onmessage = null;
      socket.close();
      connect();
    }
  }
}, 250);

map.setMap(await (await fetch("/api/map")).json());
connect();
