// Lines and curves in the world frame [m].

// A polyline in two, at a share of its length.
export function splitAt(path, share) {
  const gaps = path.slice(1).map(([x, y], i) => Math.hypot(x - path[i][0], y - path[i][1]));
  let left = share * gaps.reduce((sum, gap) => sum + gap, 0);
  const i = gaps.findIndex((gap) => (left -= gap) < 0);
  if (i < 0) return [path, []];
  const back = -left / gaps[i];
  const cut = [0, 1].map((k) => path[i + 1][k] + back * (path[i][k] - path[i + 1][k]));
  return [[...path.slice(0, i + 1), cut], [cut, ...path.slice(i + 1)]];
}

// A cubic Bezier as points, count + 1 of them.
export function sampled(c, count) {
  return Array.from({ length: count + 1 }, (_, i) => {
    const [t, u] = [i / count, 1 - i / count];
    const at = (k) => u ** 3 * c[k] + 3 * u * u * t * c[k + 2]
      + 3 * u * t * t * c[k + 4] + t ** 3 * c[k + 6];
    return [at(0), at(1)];
  });
}

// The nearest point of some polylines; null if it is farther than that.
export function snap(place, lines, farthest) {
  let [best, least] = [null, farthest];
  for (const line of lines) {
    for (let i = 1; i < line.length; i++) {
      const point = nearest(place, line[i - 1], line[i]);
      const distance = Math.hypot(point[0] - place[0], point[1] - place[1]);
      if (distance <= least) [best, least] = [point, distance];
    }
  }
  return best;
}

function nearest([x, y], [x0, y0], [x1, y1]) {
  const [dx, dy] = [x1 - x0, y1 - y0];
  const share = ((x - x0) * dx + (y - y0) * dy) / (dx * dx + dy * dy || 1);
  const t = Math.min(1, Math.max(0, share));
  return [x0 + t * dx, y0 + t * dy];
}
