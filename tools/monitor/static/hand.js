// Driving by hand: keys, the pad on the page, the five arrows, or a gamepad. Where the stick is goes out
// twenty times a second; the robot forgets each after 0.3 s, so whatever stops this page stops the robot.

import { $ } from "./panels.js";

const EVERY_MS = 50;
const TURN = 0.2; // of the keys' steering in one go: full lock in a quarter of a second
const DEAD = 0.08; // a gamepad's stick at rest is seldom at 0
const REACH_PX = 47;
const ARROWS = [[1, 0.6], [0.375, 1], [0, 1], [-0.375, 1], [-1, 0.6]]; // steer (left 1), speed
const KEYS = { ArrowUp: [0, 1], ArrowDown: [0, -1], ArrowLeft: [1, 0], ArrowRight: [-1, 0] };
const STILL = [0, 0];
const ARMED = ["READY", "MANUAL", "AUTO"];

const within = (value) => Math.max(-1, Math.min(1, value));
const moves = (stick) => stick[0] !== 0 || stick[1] !== 0;
const beyondRest = (value) => Math.sign(value) * Math.max(0, Math.abs(value) - DEAD) / (1 - DEAD);

export class Hand {
  // send(text) to the monitor; state() is the robot's.
  constructor(send, state) {
    Object.assign(this, { send, state });
    this.keys = new Set();
    this.steer = 0; // of the keys
    this.release();
    this.sent = this.away = this.resting = false;
    $("by-hand").addEventListener("change", () => this.#toggle());
    addEventListener("keydown", (event) => this.#key(event, true));
    addEventListener("keyup", (event) => this.#key(event, false));
    addEventListener("blur", () => { this.away = true; this.release(); });
    for (const here of ["focus", "keydown", "pointerdown"]) {
      addEventListener(here, () => { this.away = false; }, { capture: true });
    }
    $("stick").addEventListener("pointerdown", (event) => {
      $("stick").setPointerCapture(event.pointerId);
      this.#drag(event);
    });
    $("stick").addEventListener("pointermove", (event) => { if (event.buttons) this.#drag(event); });
    for (const end of ["pointerup", "pointercancel", "lostpointercapture"]) {
      $("stick").addEventListener(end, () => { this.pad = STILL; });
    }
    setInterval(() => this.#tick(), EVERY_MS);
  }

  get on() { return $("by-hand").checked; }

  press(action) { this.button = action; }

  release() {
    this.keys.clear();
    this.button = null;
    this.pad = STILL;
  }

  // The policy is about to drive: say nothing more until somebody steers.
  rest() {
    this.resting = true;
    this.sent = false;
  }

  off() {
    $("by-hand").checked = false;
    this.#toggle();
  }

  #toggle() {
    this.release();
    $("hand").hidden = !this.on;
    for (const button of $("actions").children) button.disabled = !this.on;
  }

  #key(event, down) {
    if (event.key === "Meta") this.keys.clear();  // macOS tells of no key let go while it is held
    if (!(event.key in KEYS) || !this.on || event.metaKey) return;
    event.preventDefault();
    if (down) this.keys.add(event.key);
    else this.keys.delete(event.key);
  }

  #drag(event) {
    const box = $("stick").getBoundingClientRect();
    this.pad = [
      within((box.x + box.width / 2 - event.clientX) / REACH_PX),
      within((box.y + box.height / 2 - event.clientY) / REACH_PX),
    ];
  }

  #keyed() {
    const [left, up] = [...this.keys].map((key) => KEYS[key])
      .reduce(([a, b], [c, d]) => [a + c, b + d], STILL);
    const wanted = up ? left / 2 : left;
    this.steer += Math.max(-TURN, Math.min(TURN, wanted - this.steer));
    if (!this.keys.size) this.steer = 0;
    return [this.steer, up || 0.6 * Math.abs(left)];
  }

  #gamepad() {
    const pad = [...(navigator.getGamepads?.() ?? [])].find((one) => one?.connected);
    if (!pad) return STILL;
    const triggers = (pad.buttons[7]?.value ?? 0) - (pad.buttons[6]?.value ?? 0);
    return [-beyondRest(pad.axes[0] ?? 0), triggers || -beyondRest(pad.axes[1] ?? 0)];
  }

  // What steers, and how.
  #stick() {
    const sources = {
      "the arrows": this.button === null ? STILL : ARROWS[this.button],
      "the pad": this.pad,
      "the keys": this.#keyed(),
      "a gamepad": this.#gamepad(),
    };
    return Object.entries(sources).find(([, stick]) => moves(stick)) ?? ["", STILL];
  }

  #tick() {
    const there = this.on && !this.away;
    const [by, stick] = there ? this.#stick() : ["", STILL];
    if (moves(stick)) this.resting = false;
    const armed = ARMED.includes(this.state());
    const holds = there && !this.resting && this.state() === "MANUAL";
    const drives = armed && (moves(stick) || holds);
    const manual = drives ? stick.map((value) => Number(value.toFixed(3))) : null;
    if (drives || this.sent) this.send(JSON.stringify({ manual }));
    this.sent = drives;
    $("knob").style.translate = `${-REACH_PX * stick[0]}px ${-REACH_PX * stick[1]}px`;
    $("hand-by").textContent = by && (armed ? `Driving by ${by}` : "Arm the robot first");
  }
}
