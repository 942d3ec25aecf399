// The map: roads, objects, planned path, trail and robot on a canvas; clicks become places.
// World frame: x east, y north, metres; the canvas has y down.

const MARGIN_PX = 18;
const BELOW_PX = 70; // room for the bar with the choice
const LANE_WIDTH = 0.42; // of a tile
const EDGE_M = 0.024;
const DASH_M = [0.06, 0.04];
const SEAM_M = 0.008;
const ROBOT_M = { length: 0.2, width: 0.15 };
const DRAG_PX = 10;
const TRAIL_POINTS = 400;
const CARRIED_M = 0.3; // farther at once and it was not driven
const GLIDE_MS = 110; // between two reports

export class MapView {
  // choose({start, destination, off}) is called with world places [x, y]; start is null for a
  // click. off names the one that is farther than a tile from any lane, and null, too.
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
    new ResizeObserver(() => this.redraw()).observe(canvas);
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => this.redraw());
    canvas.addEventListener("pointerdown", (event) => this.#down(event));
    canvas.addEventListener("pointermove", (event) => this.#move(event));
    canvas.addEventListener("pointerup", (event) => this.#up(event));
    canvas.addEventListener("pointercancel", () => { this.press = null; });
  }

  setMap(drawing) {
    this.drawing = drawing;
    this.lanePoints = drawing.lanes.flatMap((lane) => sampled(lane, 12));
    this.redraw();
  }

  // view: {pose, path, destination, progress, overhead, silent}
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
    const { width_m, height_m } = this.drawing;
    const w = this.canvas.width - 2 * MARGIN_PX * ratio;
    const h = this.canvas.height - (MARGIN_PX + BELOW_PX) * ratio;
    this.scale = Math.min(w / width_m, h / height_m);
    this.left = (this.canvas.width - width_m * this.scale) / 2;
    this.bottom = MARGIN_PX * ratio + (h + height_m * this.scale) / 2;
    this.ratio = ratio;
    const style = getComputedStyle(this.canvas);
    this.colour = (name) => style.getPropertyValue(`--${name}`).trim();
    this.ground = this.#ground();
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
    let best = null;
    let least = this.drawing.tile_size_m;
    for (const point of this.lanePoints) {
      const distance = Math.hypot(point[0] - place[0], point[1] - place[1]);
      if (distance <= least) [best, least] = [point, distance];
    }
    return best;
  }

  #down(event) {
    if (event.button !== 0 || !this.drawing) return;
    this.press = { x: event.clientX, y: event.clientY, place: this.place(event), drag: false };
  }

  #move(event) {
    if (!this.press || event.pointerType === "touch") return;
    const { x, y } = this.press;
    this.press.drag ||= Math.hypot(event.clientX - x, event.clientY - y) > DRAG_PX;
    if (this.press.drag) this.setChosen(this.#choice(event));
  }

  #up(event) {
    if (!this.press) return;
    const choice = this.#choice(event);
    this.press = null;
    this.choose(choice);
  }

  // Start and destination, or which of them lies off the road.
  #choice(event) {
    const start = this.press.drag ? this.snapped(this.press.place) : null;
    const destination = this.snapped(this.place(event));
    const off = this.press.drag && !start ? "start" : destination ? null : "destination";
    return { start, destination, off };
  }

  #animate() {
    if (this.animating) return;
    this.animating = true;
    const step = (now) => {
      this.#paint(now);
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

  #x(x) { return this.left + x * this.scale; }
  #y(y) { return this.bottom - y * this.scale; }

  #trace(pen, points) {
    pen.beginPath();
    points.forEach(([x, y], i) => pen[i ? "lineTo" : "moveTo"](this.#x(x), this.#y(y)));
  }

  // A Bezier, begun and ended a little beyond its tile so that no seam shows.
  #curve(pen, c) {
    const beyond = (x, y, fromX, fromY) => {
      const share = SEAM_M / Math.max(Math.hypot(x - fromX, y - fromY), SEAM_M);
      return [this.#x(x + share * (x - fromX)), this.#y(y + share * (y - fromY))];
    };
    pen.beginPath();
    pen.moveTo(...beyond(c[0], c[1], c[2], c[3]));
    pen.lineTo(this.#x(c[0]), this.#y(c[1]));
    pen.bezierCurveTo(this.#x(c[2]), this.#y(c[3]), this.#x(c[4]), this.#y(c[5]),
      this.#x(c[6]), this.#y(c[7]));
    pen.lineTo(...beyond(c[6], c[7], c[4], c[5]));
  }

  #ground() {
    const layer = document.createElement("canvas");
    layer.width = this.canvas.width;
    layer.height = this.canvas.height;
    const pen = layer.getContext("2d");
    const { tile_size_m: tile, floor, lanes, centre_lines, objects } = this.drawing;
    const green = floor.some(({ kind }) => kind === "grass");
    pen.fillStyle = this.colour(green ? "grass" : "floor");
    pen.fillRect(0, 0, layer.width, layer.height);
    pen.lineCap = "butt";
    const road = LANE_WIDTH * tile;
    for (const [colour, width] of [["edge", road + 2 * EDGE_M], ["road", road]]) {
      pen.strokeStyle = this.colour(colour);
      pen.lineWidth = width * this.scale;
      for (const lane of [...lanes, ...centre_lines]) { this.#curve(pen, lane); pen.stroke(); }
    }
    pen.strokeStyle = this.colour("dash");
    pen.lineWidth = EDGE_M * this.scale;
    pen.setLineDash(DASH_M.map((m) => m * this.scale));
    for (const line of centre_lines) { this.#curve(pen, line); pen.stroke(); }
    pen.setLineDash([]);
    for (const object of objects) this.#object(pen, object);
    return layer;
  }

  #object(pen, { kind, x_m, y_m, heading_rad, height_m }) {
    const [x, y, s] = [this.#x(x_m), this.#y(y_m), this.scale];
    const disc = (radius_m, colour) => {
      pen.fillStyle = this.colour(colour);
      pen.beginPath();
      pen.arc(x, y, Math.max(radius_m * s, 2.5 * this.ratio), 0, 2 * Math.PI);
      pen.fill();
    };
    if (kind === "tree") disc(0.45 * height_m, "tree");
    else if (kind === "duckie") disc(0.03, "duck");
    else if (kind === "cone" || kind === "barrier") disc(0.025, "warn");
    else if (/^(sign|traffic)/.test(kind)) disc(0.02, "quiet");
    else {
      const side = (/^(bus|truck|duckiebot)$/.test(kind) ? [0.7, 0.35] : [0.9, 0.9])
        .map((share) => share * Math.max(height_m, 0.12) * s);
      pen.save();
      pen.translate(x, y);
      pen.rotate(-heading_rad);
      pen.fillStyle = this.colour("solid");
      pen.beginPath();
      pen.roundRect(-side[0] / 2, -side[1] / 2, side[0], side[1], 0.02 * s);
      pen.fill();
      pen.restore();
    }
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
    if (overhead) this.#ring(pen, overhead);
    const pose = this.#shownPose(now);
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
    pen.arc(this.#x(x), this.#y(y), radius, 0, 2 * Math.PI);
    pen.fillStyle = filled ? this.colour(colour) : this.colour("card");
    pen.strokeStyle = filled ? this.colour("card") : this.colour(colour);
    pen.lineWidth = 2.5 * this.ratio;
    pen.fill();
    pen.stroke();
  }

  // Where the overhead camera sees the robot.
  #ring(pen, { x_m, y_m }) {
    pen.beginPath();
    const radius = Math.max(19 * this.ratio, 0.8 * ROBOT_M.length * this.scale);
    pen.arc(this.#x(x_m), this.#y(y_m), radius, 0, 2 * Math.PI);
    pen.fillStyle = "rgb(255 255 255 / 0.16)";
    pen.strokeStyle = "rgb(255 255 255 / 0.75)";
    pen.lineWidth = 1.25 * this.ratio;
    pen.fill();
    pen.stroke();
  }

  #robot(pen, [x, y, heading], silent) {
    const size = Math.max(this.scale, (16 * this.ratio) / ROBOT_M.length);
    const [length, width] = [ROBOT_M.length * size, ROBOT_M.width * size];
    pen.save();
    pen.translate(this.#x(x), this.#y(y));
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

// A polyline in two, at a share of its length.
function splitAt(path, share) {
  const gaps = path.slice(1).map(([x, y], i) => Math.hypot(x - path[i][0], y - path[i][1]));
  let left = share * gaps.reduce((sum, gap) => sum + gap, 0);
  const i = gaps.findIndex((gap) => (left -= gap) < 0);
  if (i < 0) return [path, []];
  const back = -left / gaps[i];
  const cut = [0, 1].map((k) => path[i + 1][k] + back * (path[i][k] - path[i + 1][k]));
  return [[...path.slice(0, i + 1), cut], [cut, ...path.slice(i + 1)]];
}

function sampled(c, count) {
  return Array.from({ length: count + 1 }, (_, i) => {
    const [t, u] = [i / count, 1 - i / count];
    const at = (k) => u ** 3 * c[k] + 3 * u * u * t * c[k + 2]
      + 3 * u * t * t * c[k + 4] + t ** 3 * c[k + 6];
    return [at(0), at(1)];
  });
}
