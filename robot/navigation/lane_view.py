"""What a map says of the road before a robot: its lane there, the next red line and junction.

In a junction no lane is marked. There the road is the straight one of the nearest quarter turn, as
if its lane led on across the tile: corners and red lines tell where that lies, and a robot that
turns changes from one to the other half-way.
"""

import math
from typing import Dict, List, NamedTuple, Optional, Tuple

import numpy as np

from robot.geometry import Pose, bezier_points, bezier_tangents, wrap_angle
from robot.navigation.road_map import Lane, LaneIndex, RoadMap, Tile, border_point

# What a junction offers to who comes to it: nothing is there; all ways; straight on and one side;
# both sides only.
KINDS = ("none", "cross", "left", "right", "tee")
AHEAD_M = 0.3  # over which the curvature ahead is meant
LANE_TILES = 0.2  # from the middle of the road to that of a lane
_REACH_M = 1.2  # that a lane is followed
_POINTS = 33  # of a lane
_LEAVING_RAD = 0.3  # in a junction: who is turned farther does not go straight on
_AROUND_M = 0.04  # a place, to tell how the lane bends there
_SIDES = "ENWS"  # by quarter turns from east
_WAYS = {"ALR": "cross", "AL": "left", "AR": "right", "LR": "tee"}


class LaneAhead(NamedTuple):
    """The road as a robot at a pose should see it; what bends to the left is positive."""

    offset_m: float  # of the robot to the left of its lane
    heading_rad: float  # of the robot less the lane's
    along_rad: float  # direction of the lane in the world
    bend_pm: float  # curvature of the lane here [1/m]
    curvature_pm: float  # mean of the next `AHEAD_M`; NaN where a junction is nearer
    slope_pm2: float  # by how much that grows along the lane [1/m^2]
    line_m: float  # along the lane from the axle to the near edge of the red line; infinite: none
    kind: int  # of the junction behind it, index into `KINDS`
    in_junction: bool


class LaneView:
    """The road before any pose on one map."""

    def __init__(self, road_map: RoadMap) -> None:
        self.road_map = road_map
        lanes = [lane for lane in road_map.lanes if not lane.tile.is_junction]
        begins = {border_point(e.control_points_m[0], road_map.tile_size_m): e for e in lanes}
        self._index = LaneIndex(lanes)
        self._chains = [self._follow(lane, begins) for lane in lanes]
        self.junctions = any(tile.is_junction for tile in road_map.road_tiles)  # has the map any

    def at(self, x_m: float, y_m: float, heading_rad: float) -> Optional[LaneAhead]:
        """The road before a pose; None beside it, or where none leads within 90 degrees."""
        tile = self.road_map.tile_at(x_m, y_m)
        if tile is None or not tile.is_road:
            return None
        if tile.is_junction:
            return self._crossing(tile, x_m, y_m, heading_rad)
        found = self._lane(x_m, y_m, heading_rad)
        if found is None:
            return None
        chain, arc_m, here = found
        line_m, ahead_m = chain.line_m - arc_m, arc_m + AHEAD_M
        bend_pm = chain.bend(arc_m)
        curvature_pm = chain.turn(arc_m, ahead_m) / AHEAD_M if line_m > AHEAD_M else math.nan
        slope_pm2 = (chain.bend(ahead_m) - bend_pm) / AHEAD_M
        return LaneAhead(*here, bend_pm, curvature_pm, slope_pm2, line_m, chain.kind, False)

    def _lane(
        self, x_m: float, y_m: float, heading_rad: float
    ) -> Optional[Tuple["_Chain", float, Tuple[float, float, float]]]:
        """The nearest lane that leads ahead, how far along it, offset, turn, and its direction."""
        near = self._index.near(x_m, y_m)
        turned = np.asarray(wrap_angle(heading_rad - near.heading_rad))
        along = np.flatnonzero(np.abs(turned) <= 0.5 * math.pi)
        if not len(along):
            return None
        i = int(along[near.distance_m[along].argmin()])
        steps = near.t[i] * (_POINTS - 1)
        chain = self._chains[i]
        arc_m = float(np.interp(steps, np.arange(_POINTS), chain.arcs_m[:_POINTS]))
        return chain, arc_m, (float(near.offset_m[i]), float(turned[i]), float(near.heading_rad[i]))

    def line_ahead_m(self, pose: Pose) -> float:
        """From the axle to the red line that a robot at a pose comes to; infinite where none is."""
        road = self.at(*pose) if self.junctions else None
        if road is None or (road.in_junction and abs(road.heading_rad) > _LEAVING_RAD):
            return math.inf
        return road.line_m

    def way(self, pose: Pose, ahead_m: np.ndarray) -> Optional[np.ndarray]:
        """The middle of the own lane (K, 2), so far ahead (K,); None where `at` finds no road.

        In a junction, beyond the lane's end there, and after 0.8 m or more, it goes straight on.
        """
        road = self.at(*pose)
        if road is None:
            return None
        steps_m = np.diff(ahead_m, prepend=0.0)
        along = np.full(len(ahead_m), road.along_rad)
        found = None if road.in_junction else self._lane(*pose)
        if found is not None:
            chain, arc_m = found[:2]
            along += np.interp(arc_m + ahead_m - 0.5 * steps_m, chain.arcs_m, chain.headings_rad)
            along -= np.interp(arc_m, chain.arcs_m, chain.headings_rad)
        steps = steps_m[:, None] * np.stack((np.cos(along), np.sin(along)), axis=1)
        left = np.array((-math.sin(road.along_rad), math.cos(road.along_rad)))
        return np.array((pose.x_m, pose.y_m)) - road.offset_m * left + np.cumsum(steps, axis=0)

    def _crossing(self, tile: Tile, x_m: float, y_m: float, heading_rad: float) -> LaneAhead:
        size_m = self.road_map.tile_size_m
        quarter = round(heading_rad / (0.5 * math.pi)) % 4
        along_rad = float(wrap_angle(quarter * 0.5 * math.pi))
        c, s = math.cos(along_rad), math.sin(along_rad)
        x_m -= (tile.column + 0.5) * size_m
        y_m -= (self.road_map.rows - tile.row - 0.5) * size_m
        rest_m = 0.5 * size_m - (c * x_m + s * y_m)
        offset_m = c * y_m - s * x_m + LANE_TILES * size_m
        kind = self._beyond(tile, quarter) if _SIDES[quarter] in tile.road_sides else 0
        turned_rad = float(wrap_angle(heading_rad - along_rad))
        line_m = rest_m if kind else math.inf
        return LaneAhead(offset_m, turned_rad, along_rad, 0.0, math.nan, 0.0, line_m, kind, True)

    def _beyond(self, tile: Tile, quarter: int) -> int:
        """The kind of the junction that lies next to a tile on one side; 0 for none."""
        other = self.road_map.beyond(tile, _SIDES[quarter])
        if other is None or not other.is_junction or _SIDES[quarter - 2] not in other.road_sides:
            return 0
        ways = {"A": _SIDES[quarter], "L": _SIDES[quarter - 3], "R": _SIDES[quarter - 1]}
        open_ways = "".join(way for way, side in ways.items() if side in other.road_sides)
        return KINDS.index(_WAYS.get(open_ways, "none"))

    def _follow(self, lane: Lane, begins: Dict[Tuple[int, int], Lane]) -> "_Chain":
        """A lane and those after it, up to a junction or for `_REACH_M`."""
        t, kind, length_m = np.linspace(0.0, 1.0, _POINTS), 0, 0.0
        arcs_m: List[np.ndarray] = []
        headings: List[np.ndarray] = []
        follows: Optional[Lane] = lane
        while follows is not None and not kind and length_m < _REACH_M:
            control = follows.control_points_m
            steps_m = np.hypot(*np.diff(bezier_points(control, t), axis=0).T)
            arcs_m.append(length_m + np.concatenate(([0.0], np.cumsum(steps_m))))
            headings.append(np.arctan2(*bezier_tangents(control, t).T[::-1]))
            length_m = float(arcs_m[-1][-1])
            quarter = round(float(headings[-1][-1]) / (0.5 * math.pi)) % 4
            kind = self._beyond(follows.tile, quarter)
            follows = begins.get(border_point(control[3], self.road_map.tile_size_m))
        line_m = length_m if kind else math.inf
        return _Chain(np.concatenate(arcs_m), np.unwrap(np.concatenate(headings)), line_m, kind)


class _Chain(NamedTuple):
    """A lane and what follows it: directions (K,) at arc lengths (K,), and how it ends."""

    arcs_m: np.ndarray
    headings_rad: np.ndarray
    line_m: float
    kind: int

    def turn(self, begin_m: float, end_m: float) -> float:
        """How the direction changes between two arc lengths [rad]."""
        begin, end = np.interp((begin_m, end_m), self.arcs_m, self.headings_rad).tolist()
        return float(end - begin)

    def bend(self, arc_m: float) -> float:
        """The curvature at an arc length [1/m]."""
        return self.turn(arc_m - _AROUND_M, arc_m + _AROUND_M) / (2.0 * _AROUND_M)
