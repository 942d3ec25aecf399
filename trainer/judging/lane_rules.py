"""The AI Driving Olympics' figures of a drive, by duckietown-world's rules (`in_drivable_lane.py`).

Its lanes are not ours: 0.376 tiles wide, their middle 0.22 tiles beside the road's, on bends drawn
through three poses by constant twists. Along them its figures are counted, quirks included: a tile
counts in the lane that was used there first, and no lane at all is no deviation. One thing is ours:
the deviation is in metres, where theirs is in tiles.
"""

from __future__ import annotations

import cmath
import itertools
import math
from collections.abc import Sequence
from functools import cache
from typing import NamedTuple

import numpy as np

from robot.geometry import Pose, wrap_angle
from robot.navigation.lanes import ORIENTATIONS, Tile
from robot.navigation.road_map import RoadMap

LANE_TILES = 0.376
# Poses that a lane leads through, in tiles and degrees; it comes from the west. By the quarters of
# a junction that it passes: to the right, straight on, to the left.
_THROUGH = {
    1: ((-0.5, -0.22, 0.0), (-0.3, -0.3, -45.0), (-0.22, -0.5, -90.0)),
    2: ((-0.5, -0.22, 0.0), (0.5, -0.22, 0.0)),
    3: ((-0.5, -0.22, 0.0), (0.0, 0.0, 45.0), (0.22, 0.5, 90.0)),
}
_ZONE_M = 0.35  # before a junction, measured at the axle
_STILL_MPS = 0.02
_WEST = ORIENTATIONS.index("W")
_STEPS = 64  # between two poses of a bend: exact to 0.01 mm


class LaneFigures(NamedTuple):
    """One drive. Names are the Olympics', with underscores."""

    survival_time: float  # [s]
    driven_lanedir_consec: float  # [m] along the first lane of each tile
    deviation_center_line: float  # [m s]: its distance over time, 0 where there is no lane
    in_drivable_lane: float  # [s] without a lane within 90 degrees
    deviation_heading: float  # [rad s]
    distance_from_start: float  # [m], the greatest


class _Lane(NamedTuple):
    """Where one pose is in a lane of its tile."""

    askew_rad: float  # either way
    name: int
    lateral_m: float
    middle: np.ndarray  # (3,) the nearest pose of the lane, in the world


class LaneRules:
    """Judges drives on one map."""

    def __init__(self, road_map: RoadMap) -> None:
        self._map, self.tile_size_m = road_map, road_map.tile_size_m
        self._half_m = 0.5 * LANE_TILES * road_map.tile_size_m

    def lines_run(self, poses: np.ndarray, dt_s: float) -> int:
        """How many junctions a drive as below entered without standing before them.

        A robot must stand somewhere on the last `_ZONE_M`; who began nearer is not judged.
        """
        way_m = np.hypot(*np.diff(poses[:, :2], axis=0).T)
        tiles = [self._map.tile_at(x_m, y_m) for x_m, y_m in poses[:, :2].tolist()]
        inside = np.array([tile is not None and tile.is_junction for tile in tiles])
        driven_m, run = np.concatenate(([0.0], np.cumsum(way_m))), 0
        for k in (np.flatnonzero(inside[1:] & ~inside[:-1]) + 1).tolist():
            first = int(np.searchsorted(driven_m, driven_m[k] - _ZONE_M))
            run += first > 0 and not (way_m[first:k] < _STILL_MPS * dt_s).any()
        return run

    def figures(self, poses: np.ndarray, dt_s: float) -> LaneFigures:
        """Of a drive through poses (T, 3), one each ``dt_s``; T is at least 1."""
        lanes = [self._lanes(pose) for pose in poses[:-1]]
        seen = [where[0] for where in lanes if where]
        start = poses[0, :2]
        return LaneFigures(
            dt_s * len(lanes),
            self._driven_m(poses, lanes),
            dt_s * sum(abs(lane.lateral_m) for lane in seen),
            dt_s * (len(lanes) - len(seen)),
            dt_s * sum(lane.askew_rad for lane in seen),
            float(np.hypot(*(poses[:, :2] - start).T).max()),
        )

    def _driven_m(self, poses: np.ndarray, lanes: Sequence[list[_Lane]]) -> float:
        """Along the lanes, on each tile along that of them which was the first there."""
        first: dict[tuple[int, int], int] = {}
        total_m = 0.0
        for pose, then, where in zip(poses, poses[1:], lanes, strict=False):
            tile = self._map.tile_at(pose[0], pose[1])
            if where and tile is not None:
                used = first.setdefault((tile.row, tile.column), where[0].name)
                ways = [
                    Pose(*each.middle).to_robot(then[:2])[0] for each in where if each.name == used
                ]
                total_m += max(map(float, ways), default=0.0)
        return total_m

    def _lanes(self, pose: np.ndarray) -> list[_Lane]:
        """The lanes that a pose is in, best aligned first."""
        tile = self._map.tile_at(pose[0], pose[1])
        if tile is None or not tile.is_road:
            return []
        size_m = self._map.tile_size_m
        centre = np.array([tile.column + 0.5, self._map.rows - tile.row - 0.5]) * size_m
        found = []
        for name, course in enumerate(_courses(tile)):
            lane = course * (size_m, size_m, 1.0) + (*centre, 0.0)
            middle = _abeam(lane, pose[:2])
            if middle is None:
                continue
            lateral_m = float(Pose(*middle).to_robot(pose[:2])[1])
            askew_rad = abs(float(wrap_angle(pose[2] - middle[2])))
            if abs(lateral_m) <= self._half_m and askew_rad <= 0.5 * math.pi:
                found.append(_Lane(askew_rad, name, lateral_m, middle))
        return sorted(found, key=lambda lane: lane[:2])


def _abeam(lane: np.ndarray, point: np.ndarray) -> np.ndarray | None:
    """The pose of a lane (P, 3) that has a point (2,) exactly beside it; None if none has."""
    c, s = np.cos(lane[:, 2]), np.sin(lane[:, 2])
    ahead = c * (point[0] - lane[:, 0]) + s * (point[1] - lane[:, 1])
    found = np.flatnonzero((ahead[:-1] >= 0.0) & (ahead[1:] < 0.0))
    if not len(found):
        return None
    shares = ahead[found] / (ahead[found] - ahead[found + 1])
    poses = lane[found] + shares[:, None] * (lane[found + 1] - lane[found])
    nearest = np.hypot(*(poses[:, :2] - point).T).argmin()
    return np.asarray(poses[nearest])


@cache
def _courses(tile: Tile) -> tuple[np.ndarray, ...]:
    """The lanes of a tile, each (P, 3) in tiles from its middle: from every side to every other."""
    sides = [ORIENTATIONS.index(side) for side in tile.road_sides]
    found = []
    for entry in sides:
        for quarters in (1, 2, 3):
            if (entry + quarters) % 4 in sides:
                found.append(_turned(_course(quarters), entry - _WEST))
    return tuple(found)


@cache
def _course(quarters: int) -> np.ndarray:
    through = [(x, y, math.radians(degrees)) for x, y, degrees in _THROUGH[quarters]]
    legs = [_screw(a, b)[:-1] for a, b in itertools.pairwise(through)]
    return np.concatenate((*legs, [through[-1]]))


def _screw(a: Sequence[float], b: Sequence[float]) -> np.ndarray:
    """(P, 3) poses from a to b by a constant twist: interpolation in SE(2)."""
    share, turn = np.linspace(0.0, 1.0, _STEPS + 1), b[2] - a[2]
    first, last = complex(a[0], a[1]), complex(b[0], b[1])
    if turn == 0.0:
        way = first + share * (last - first)
    else:  # about the point that stays where it is
        whole = cmath.exp(1j * turn)
        centre = (last - whole * first) / (1.0 - whole)
        way = centre + np.exp(1j * turn * share) * (first - centre)
    return np.column_stack((way.real, way.imag, a[2] + share * turn))


def _turned(course: np.ndarray, quarter_turns: int) -> np.ndarray:
    x, y, heading = course.T
    way, turn = (x + 1j * y) * 1j**quarter_turns, 0.5 * math.pi * (quarter_turns % 4)
    return np.column_stack((way.real, way.imag, heading + turn))
