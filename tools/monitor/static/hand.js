// Driving by hand: while an arrow is held, its action is sent every 100 ms. The robot forgets each
// after 0.3 s, so whatever stops this page stops the robot.

import { $ } from "./panels.js";

const EVERY_MS = 100;
const STICKS = [[1, 0.6], [0.375, 1], [0, 1], [-0.375, 1], [-1, 0.6]]; // steer, speed
const KEYS = ["ArrowUp", "ArrowLeft", "ArrowRight"];

export class Hand {
  constructor(send) {
    this.send = send;
    this.keys = new Set();
    this.button = null;
    this.last = null;
    $("by-hand").addEventListener("change", () => this.#toggle());
    addEventListener("keydown", (event) => this.#key(event, true));
    addEventListener("keyup", (event) => this.#key(event, false));
    addEventListener("blur", () => this.release());
    setInterval(() => this.#tick(), EVERY_MS);
  }

  get on() { return $("by-hand").checked; }

  press(action) { this.button = action; }

  release() {
    this.keys.clear();
    this.button = null;
  }

  off() {
    $("by-hand").checked = false;
    this.#toggle();
  }

  #toggle() {
    this.release();
    $("hand-hint").hidden = !this.on;
    for (const button of $("actions").children) button.disabled = !this.on;
  }

  #key(event, down) {
    if (!KEYS.includes(event.key) || !this.on) return;
    event.preventDefault();
    if (down) this.keys.add(event.key);
    else this.keys.delete(event.key);
  }

  #action() {
    if (this.button !== null) return this.button;
    const [up, left, right] = KEYS.map((key) => this.keys.has(key));
    if (left === right) return up ? 2 : null;
    return left ? (up ? 1 : 0) : (up ? 3 : 4);
  }

  #tick() {
    const action = this.on ? this.#action() : null;
    if (action !== null || this.last !== null) {
      this.send(JSON.stringify({ manual: action === null ? null : STICKS[action] }));
    }
    this.last = action;
  }
}
