"""Where the yellow line of a ring of road really runs, from the map alone."""

from __future__ import annotations

import numpy as np

from robot.geometry import bezier_points
from robot.navigation.lanes import Lane
from robot.navigation.path import Path, lane_loop
from robot.navigation.road_map import RoadMap

SAMPLES = 200  # per tile
SPACING_M = 0.01


def yellow_middle(road_map: RoadMap) -> Path:
    """The middle between the two lanes of a ring, driven as its outer lane, closed.

    Raises:
        MapError: the road is no ring.
    """
    outer = lane_loop(road_map, outer=True)
    lanes: dict[tuple[int, int], list[Lane]] = {}
    for lane in road_map.lanes:
        lanes.setdefault((lane.tile_row, lane.tile_column), []).append(lane)
    pieces = [
        _between(lanes[tile][0], lanes[tile][1], road_map) for tile in _tiles_along(outer, road_map)
    ]
    pieces = [piece if _leads_along(piece, outer) else piece[::-1] for piece in pieces]
    return _closed_path(np.concatenate([piece[:-1] for piece in pieces]))


def _between(lane: Lane, other: Lane, road_map: RoadMap) -> np.ndarray:
    """(SAMPLES, 2) [m]: half way between two opposite lanes, about the corner of a curve."""
    t = np.linspace(0.0, 1.0, SAMPLES)
    a, b = (bezier_points(np.asarray(each.control_points_m), t) for each in (lane, other))
    if road_map.tiles[lane.tile_row][lane.tile_column].kind == "straight":
        return 0.5 * (a + b[::-1])
    south = road_map.rows - 1 - lane.tile_row
    corners = np.array(
        [(lane.tile_column + i, south + j) for i in (0, 1) for j in (0, 1)], dtype=float
    )
    corners *= road_map.tile_size_m
    middle = 0.5 * (a[SAMPLES // 2] + b[SAMPLES // 2])
    corner = corners[np.argmin(np.hypot(*(corners - middle).T))]
    toward = np.arctan2(*(middle - corner)[::-1])
    angles, radii = _polar(a - corner, toward)
    other_angles, other_radii = _polar(b - corner, toward)
    order = np.argsort(other_angles)
    radii = 0.5 * (radii + np.interp(angles, other_angles[order], other_radii[order]))
    around = angles + toward
    return corner + radii[:, None] * np.stack((np.cos(around), np.sin(around)), axis=1)


def _polar(offsets: np.ndarray, toward_rad: float) -> tuple[np.ndarray, np.ndarray]:
    """Angles from ``toward_rad`` and lengths of vectors (M, 2)."""
    angles = np.arctan2(offsets[:, 1], offsets[:, 0]) - toward_rad
    return (angles + np.pi) % (2.0 * np.pi) - np.pi, np.hypot(*offsets.T)


def _tiles_along(path: Path, road_map: RoadMap) -> list[tuple[int, int]]:
    cells = np.floor(path.points_m / road_map.tile_size_m).astype(int)
    tiles = [(road_map.rows - 1 - int(y), int(x)) for x, y in cells]
    return [tile for i, tile in enumerate(tiles) if tile != tiles[i - 1]]


def _leads_along(piece: np.ndarray, path: Path) -> bool:
    middle = piece[len(piece) // 2]
    heading = path.project(middle[0], middle[1]).heading_rad
    along = piece[len(piece) // 2 + 1] - middle
    return bool(along @ (np.cos(heading), np.sin(heading)) > 0.0)


def _closed_path(points: np.ndarray) -> Path:
    ring = np.vstack((points, points[:1]))
    arc = np.concatenate(([0.0], np.cumsum(np.hypot(*np.diff(ring, axis=0).T))))
    count = int(arc[-1] / SPACING_M)
    arc_m = np.arange(count) * (arc[-1] / count)
    spaced = np.stack([np.interp(arc_m, arc, ring[:, i]) for i in (0, 1)], axis=1)
    tangents = np.roll(spaced, -1, axis=0) - np.roll(spaced, 1, axis=0)
    headings = np.arctan2(tangents[:, 1], tangents[:, 0])
    return Path(spaced, headings, arc_m, True, float(arc[-1]))
