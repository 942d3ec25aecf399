// The floor, the roads and what stands beside them.

const LANE_WIDTH = 0.42; // of a tile
const EDGE_M = 0.024;
const DASH_M = [0.06, 0.04];
const SEAM_M = 0.008;

// What stands still, on a canvas of its own; view: a MapView.
export function drawGround(view) {
  const layer = view.ground ?? document.createElement("canvas");
  layer.width = view.canvas.width;
  layer.height = view.canvas.height;
  const pen = layer.getContext("2d");
  const { tile_size_m: tile, floor, lanes, centre_lines, objects } = view.drawing;
  const green = floor.some(({ kind }) => kind === "grass");
  pen.fillStyle = view.colour(green ? "grass" : "floor");
  pen.fillRect(0, 0, layer.width, layer.height);
  pen.lineCap = "butt";
  const road = LANE_WIDTH * tile;
  for (const [colour, width] of [["edge", road + 2 * EDGE_M], ["road", road]]) {
    pen.strokeStyle = view.colour(colour);
    pen.lineWidth = width * view.scale;
    for (const lane of [...lanes, ...centre_lines]) { curve(pen, view, lane); pen.stroke(); }
  }
  pen.strokeStyle = view.colour("dash");
  pen.lineWidth = EDGE_M * view.scale;
  pen.setLineDash(DASH_M.map((m) => m * view.scale));
  for (const line of centre_lines) { curve(pen, view, line); pen.stroke(); }
  pen.setLineDash([]);
  for (const object of objects) drawObject(pen, view, object);
  return layer;
}

// A Bezier, begun and ended a little beyond its tile so that no seam shows.
function curve(pen, view, c) {
  const beyond = (x, y, fromX, fromY) => {
    const share = SEAM_M / Math.max(Math.hypot(x - fromX, y - fromY), SEAM_M);
    return [view.x(x + share * (x - fromX)), view.y(y + share * (y - fromY))];
  };
  pen.beginPath();
  pen.moveTo(...beyond(c[0], c[1], c[2], c[3]));
  pen.lineTo(view.x(c[0]), view.y(c[1]));
  pen.bezierCurveTo(view.x(c[2]), view.y(c[3]), view.x(c[4]), view.y(c[5]),
    view.x(c[6]), view.y(c[7]));
  pen.lineTo(...beyond(c[6], c[7], c[4], c[5]));
}

function drawObject(pen, view, { kind, x_m, y_m, heading_rad, height_m }) {
  const [x, y, s] = [view.x(x_m), view.y(y_m), view.scale];
  const disc = (radius_m, colour) => {
    pen.fillStyle = view.colour(colour);
    pen.beginPath();
    pen.arc(x, y, Math.max(radius_m * s, 2.5 * view.ratio), 0, 2 * Math.PI);
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
    pen.fillStyle = view.colour("solid");
    pen.beginPath();
    pen.roundRect(-side[0] / 2, -side[1] / 2, side[0], side[1], 0.02 * s);
    pen.fill();
    pen.restore();
  }
}
