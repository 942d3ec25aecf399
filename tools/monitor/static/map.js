// The map: roads, objects, planned path, trail and robot on a canvas; clicks become places.
// World frame: x east, y north, metres; the canvas has y down.

import { sampled, snap, splitAt } from "./geometry.js";
import { drawGround } from "./ground.js";
import { $ } from "./panels.js";

const MARGIN_PX = 18;
const ABOVE_PX = 50; // room for the buttons
const BELOW_PX = 70; // and for the bar with the choice
const ROBOT_M = { length: 0.2, width: 0.15 };
const DRAG_PX = 10;
const TRAIL_POINTS = 400;
const CARRIED_M = 0.3; // farther at once and it was not driven
const GLIDE_MS = 110; // between two reports
const MOST_ZOOM = 8;
const FOLLOW_ZOOM = 2.5;
const BUBBLE_PX = 150; // half the width of a refusal

export class MapView {
  // choose({start, destination, off, clicked}) is called with world places [x, y]; start is null
  // for a click. off names the one that is farther than a tile from any lane, and null, too;
  // clicked is where that was.
  constructor(canvas, choose) {
    this.canvas = canvas;
    this.choose = choose;
    this.drawing = null;
    this.view = null;
    this.chosen = null;
    this.trail = [];
    this.pose = null;
    this.from = null;
    this.press = null;
    this.hover = null; // where a click would lead
    this.refused = null; // {place, why}
    this.ground = null;
    this.zoom = 1; // 1 shows all of the map
    this.following = false;
    this.fingers = new Map();
    new ResizeObserver(() => this.redraw()).observe(canvas);
    const on = (name, what) => canvas.addEventListener(name, what, { passive: false });
    on("pointerdown", (event) => this.#down(event));
    on("pointermove", (event) => this.#move(event));
    on("pointerup", (event) => this.#up(event));
    on("pointerleave", (event) => this.#lift(event));
    on("pointercancel", (event) => { this.press = null; this.#lift(event); });
    on("wheel", (event) => {
      event.preventDefault();
      this.#zoomAt(event, this.zoom * 1.0015 ** -event.deltaY);
    });
  }

  setMap(drawing) {
    this.drawing = drawing;
    this.lanes = drawing.lanes.map((lane) => sampled(lane, 12));
    this.centre = [drawing.width_m / 2, drawing.height_m / 2];
    this.redraw();
  }

  // Keep the robot in the middle, or show all of the map.
  follow(on) {
    this.following = on;
    this.zoom = on ? Math.max(this.zoom, FOLLOW_ZOOM) : 1;
    this.#aim();
  }

  // Say beside a place why the robot does not go there; nothing without a reason.
  refuse(place, why) {
    this.refused = why ? { place, why } : null;
    $("problem").textContent = why;
    $("problem").hidden = !why;
    this.#paint();
  }

  // view: {pose, belief, path, destination, progress, overhead, silent}
  show(view) {
    this.view = view;
    if (view.pose) {
      const last = this.trail.at(-1) ?? view.pose;
      const moved = Math.hypot(view.pose[0] - last[0], view.pose[1] - last[1]);
      if (moved > CARRIED_M) this.trail = [];
      if (moved > 0.02 || !this.trail.length) this.trail.push([view.pose[0], view.pose[1]]);
      this.trail.splice(0, this.trail.length - TRAIL_POINTS);
    }
    this.from = this.pose && this.#shownPose(performance.now());
    this.pose = view.pose;
    this.since = performance.now();
    this.#animate();
  }

  setChosen(chosen) {
    this.chosen = chosen;
    this.#paint();
  }

  clearTrail() {
    this.trail = [];
    this.pose = null;
  }

  redraw() {
    if (!this.drawing || !this.canvas.clientWidth) return;
    const ratio = window.devicePixelRatio || 1;
    this.canvas.width = Math.round(this.canvas.clientWidth * ratio);
    this.canvas.height = Math.round(this.canvas.clientHeight * ratio);
    this.ratio = ratio;
    const style = getComputedStyle(this.canvas);
    const colours = {};
    this.colour = (name) => {
      if (!colours[name]) {
        this.canvas.style.color = `var(--${name})`; // resolved for the theme
        colours[name] = style.color;
      }
      return colours[name];
    };
    this.#aim();
  }

  // From world to canvas, and the ground as it is seen so.
  #aim() {
    if (!this.colour) return;
    const { width_m, height_m } = this.drawing;
    const w = this.canvas.width - 2 * MARGIN_PX * this.ratio;
    const h = this.canvas.height - (ABOVE_PX + BELOW_PX) * this.ratio;
    this.scale = this.zoom * Math.min(w / width_m, h / height_m);
    const pose = this.following && this.#shownPose(performance.now());
    if (pose) this.centre = pose.slice(0, 2);
    // No farther than the edge of the map, and in the middle where all of it is in sight.
    const kept = (centre, size_m, seen) => {
      const most = Math.max(0, (size_m - seen / this.scale) / 2);
      return Math.min(Math.max(centre, size_m / 2 - most), size_m / 2 + most);
    };
    this.centre = [kept(this.centre[0], width_m, w), kept(this.centre[1], height_m, h)];
    this.left = this.canvas.width / 2 - this.centre[0] * this.scale;
    this.bottom = ABOVE_PX * this.ratio + h / 2 + this.centre[1] * this.scale;
    this.ground = drawGround(this);
    this.#paint();
  }

  place(event) {
    const box = this.canvas.getBoundingClientRect();
    const [px, py] = [(event.clientX - box.left) * this.ratio,
      (event.clientY - box.top) * this.ratio];
    return [(px - this.left) / this.scale, (this.bottom - py) / this.scale];
  }

  // The nearest point of a lane within a tile; null farther from the road.
  snapped(place) {
    return snap(place, this.lanes, this.drawing.tile_size_m);
  }

  // The place under the pointer stays under it.
  #zoomAt(event, zoom) {
    const [x, y] = this.place(event);
    const before = this.scale;
    this.zoom = Math.min(MOST_ZOOM, Math.max(1, zoom));
    this.#aim();
    const [nowX, nowY] = this.place(event);
    if (this.scale === before || this.following) return;
    this.centre = [this.centre[0] + x - nowX, this.centre[1] + y - nowY];
    this.#aim();
  }

  #down(event) {
    if (event.button !== 0 || !this.drawing) return;
    this.fingers.set(event.pointerId, event);
    const alone = this.fingers.size === 1;
    this.press = alone
      ? { x: event.clientX, y: event.clientY, place: this.place(event), drag: false } : null;
  }

  #move(event) {
    if (this.fingers.size === 2 && this.fingers.has(event.pointerId)) return this.#pinch(event);
    const touch = event.pointerType === "touch";
    if (!this.press) {
      this.hover = touch || !this.drawing ? null : this.snapped(this.place(event));
      return this.#paint();
    }
    const { x, y } = this.press;
    const far = Math.hypot(event.clientX - x, event.clientY - y) > DRAG_PX;
    if (touch) { if (far) this.press = null; return; } // the page is being scrolled
    this.press.drag ||= far;
    if (this.press.drag) this.setChosen(this.#choice(event));
  }

  // Two fingers: what is between them stays between them.
  #pinch(event) {
    const apart = () => {
      const [a, b] = [...this.fingers.values()];
      return { clientX: (a.clientX + b.clientX) / 2, clientY: (a.clientY + b.clientY) / 2,
        size: Math.hypot(a.clientX - b.clientX, a.clientY - b.clientY) || 1 };
    };
    const before = apart();
    const held = this.place(before);
    this.fingers.set(event.pointerId, event);
    const after = apart();
    this.zoom = Math.min(MOST_ZOOM, Math.max(1, this.zoom * after.size / before.size));
    this.#aim();
    const now = this.place(after);
    this.centre = this.centre.map((middle, i) => middle + held[i] - now[i]);
    this.#aim();
  }

  #lift(event) {
    this.fingers.delete(event.pointerId);
    this.hover = null;
    this.#paint();
  }

  #up(event) {
    this.fingers.delete(event.pointerId);
    if (!this.press) return;
    const choice = this.#choice(event);
    this.press = null;
    this.hover = null;
    this.choose(choice);
  }

  // Start and destination, or which of them lies off the road.
  #choice(event) {
    const places = { start: this.press.drag ? this.press.place : null, destination: this.place(event) };
    const start = places.start && this.snapped(places.start);
    const destination = this.snapped(places.destination);
    const off = places.start && !start ? "start" : destination ? null : "destination";
    return { start, destination, off, clicked: places[off] };
  }

  #animate() {
    if (this.animating) return;
    this.animating = true;
    const step = (now) => {
      if (this.following) this.#aim();
      else this.#paint(now);
      this.animating = now - this.since < GLIDE_MS;
      if (this.animating) requestAnimationFrame(step);
    };
    requestAnimationFrame(step);
  }

  #shownPose(now) {
    if (!this.from || !this.pose) return this.pose;
    const share = Math.min(1, (now - this.since) / GLIDE_MS);
    const turn = Math.atan2(Math.sin(this.pose[2] - this.from[2]),
      Math.cos(this.pose[2] - this.from[2]));
    const moved = Math.hypot(this.pose[0] - this.from[0], this.pose[1] - this.from[1]);
    if (moved > CARRIED_M) return this.pose;
    return [0, 1].map((i) => this.from[i] + share * (this.pose[i] - this.from[i]))
      .concat(this.from[2] + share * turn);
  }

  x(x) { return this.left + x * this.scale; }
  y(y) { return this.bottom - y * this.scale; }

  #trace(pen, points) {
    pen.beginPath();
    points.forEach(([x, y], i) => pen[i ? "lineTo" : "moveTo"](this.x(x), this.y(y)));
  }

  #paint(now = performance.now()) {
    if (!this.ground) return;
    const pen = this.canvas.getContext("2d");
    pen.clearRect(0, 0, this.canvas.width, this.canvas.height);
    pen.drawImage(this.ground, 0, 0);
    pen.lineJoin = pen.lineCap = "round";
    const { path = [], destination, overhead, silent, progress = 0 } = this.view || {};
    if (path.length > 1) {
      const [done, left] = splitAt(path, progress);
      this.#line(pen, done, "accent", 0.02, 0.3);
      this.#line(pen, left, "accent", 0.042, 0.9);
    }
    this.#line(pen, this.trail, "duck", 0.016, 0.75);
    if (destination) this.#pin(pen, destination, "accent", true);
    if (this.chosen) {
      const { start, destination: to } = this.chosen;
      if (start) {
        pen.setLineDash([6 * this.ratio, 6 * this.ratio]);
        if (to) this.#line(pen, [start, to], "text", 0.012, 0.6);
        pen.setLineDash([]);
        this.#pin(pen, start, "text", false);
      }
      if (to) this.#pin(pen, to, "text", true);
    }
    if (this.hover) this.#pin(pen, this.hover, "quiet", false);
    if (this.refused) this.#cross(pen, this.refused.place);
    if (overhead) this.#ring(pen, overhead);
    const pose = this.#shownPose(now);
    if (pose && this.view.belief) this.#ellipse(pen, pose, this.view.belief);
    if (pose) this.#robot(pen, pose, silent);
  }

  #line(pen, points, colour, width_m, alpha) {
    if (points.length < 2) return;
    pen.globalAlpha = alpha;
    pen.strokeStyle = this.colour(colour);
    pen.lineWidth = Math.max(width_m * this.scale, 1.5 * this.ratio);
    this.#trace(pen, points);
    pen.stroke();
    pen.globalAlpha = 1;
  }

  #pin(pen, [x, y], colour, filled) {
    const radius = 7 * this.ratio;
    pen.beginPath();
    pen.arc(this.x(x), this.y(y), radius, 0, 2 * Math.PI);
    pen.fillStyle = filled ? this.colour(colour) : this.colour("card");
    pen.strokeStyle = filled ? this.colour("card") : this.colour(colour);
    pen.lineWidth = 2.5 * this.ratio;
    pen.fill();
    pen.stroke();
  }

  // A place that was refused, with the reason above it or, near the upper edge, below it.
  #cross(pen, [x, y]) {
    const [px, py, arm] = [this.x(x), this.y(y), 8 * this.ratio];
    pen.strokeStyle = this.colour("bad");
    pen.lineWidth = 4 * this.ratio;
    pen.beginPath();
    for (const side of [-1, 1]) {
      pen.moveTo(px - arm, py - side * arm);
      pen.lineTo(px + arm, py + side * arm);
    }
    pen.stroke();
    const { style } = $("problem");
    const half = Math.min(BUBBLE_PX, this.canvas.clientWidth / 2 - 12);
    const middle = Math.min(Math.max(px / this.ratio, half), this.canvas.clientWidth - half);
    const below = py / this.ratio < 110;
    Object.assign(style, { left: `${middle}px`, top: `${py / this.ratio + (below ? 16 : -16)}px`,
      maxWidth: `${2 * half}px`, transform: `translate(-50%, ${below ? 0 : -100}%)` });
  }

  // Where the overhead camera sees the robot.
  #ring(pen, { x_m, y_m }) {
    pen.beginPath();
    const radius = Math.max(19 * this.ratio, 0.8 * ROBOT_M.length * this.scale);
    pen.arc(this.x(x_m), this.y(y_m), radius, 0, 2 * Math.PI);
    pen.fillStyle = "rgb(255 255 255 / 0.16)";
    pen.strokeStyle = "rgb(255 255 255 / 0.75)";
    pen.lineWidth = 1.25 * this.ratio;
    pen.fill();
    pen.stroke();
  }

  // Where the robot may be, and what tells it.
  #ellipse(pen, [x, y], { long_m, short_m, along_rad, source }) {
    const [px, py] = [this.x(x), this.y(y)];
    pen.beginPath();
    pen.ellipse(px, py, long_m * this.scale, short_m * this.scale, -along_rad, 0, 2 * Math.PI);
    pen.strokeStyle = pen.fillStyle = this.colour("accent");
    pen.globalAlpha = 0.2;
    pen.fill();
    pen.globalAlpha = 1;
    pen.lineWidth = 1.5 * this.ratio;
    pen.stroke();
    pen.font = `${11 * this.ratio}px sans-serif`;
    pen.fillText(source, px + 14 * this.ratio, py - 12 * this.ratio);
  }

  #robot(pen, [x, y, heading], silent) {
    const size = Math.max(this.scale, (16 * this.ratio) / ROBOT_M.length);
    const [length, width] = [ROBOT_M.length * size, ROBOT_M.width * size];
    pen.save();
    pen.translate(this.x(x), this.y(y));
    pen.rotate(-heading);
    pen.beginPath();
    pen.moveTo(0.6 * length, 0);
    pen.lineTo(-0.4 * length, 0.5 * width);
    pen.lineTo(-0.22 * length, 0);
    pen.lineTo(-0.4 * length, -0.5 * width);
    pen.closePath();
    pen.lineWidth = 2.5 * this.ratio;
    pen.strokeStyle = silent ? this.colour("bad") : "#22252a";
    pen.fillStyle = silent ? this.colour("card") : this.colour("duck");
    pen.stroke();
    pen.fill();
    pen.restore();
  }
}
