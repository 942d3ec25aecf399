"""``Path``: what a robot should drive along, as points evenly spaced by arc length."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import FrozenSet, List, Optional, Sequence, Tuple

import numpy as np

from robot.errors import MapError, PlanError
from robot.geometry import Pose, bezier_points, bezier_tangents, wrap_angle
from robot.navigation.lanes import Lane, border_point
from robot.navigation.path_batch import NO_HINT, PathBatch
from robot.navigation.road_map import RoadMap

SPACING_M = 0.02
MAX_GAP_M = 0.02  # between the end of one Bezier and the start of the next
_SAMPLES = 128  # per Bezier, to measure arc length


@dataclass(frozen=True)
class PathPosition:
    """Where a position lies on a path."""

    index: int  # of the nearest segment: the hint for the next call
    arc_m: float  # length of the path up to the nearest point
    offset_m: float  # distance from the path, positive to the left
    heading_rad: float  # of the path there


@dataclass(frozen=True, eq=False)
class Path:
    """Points (M, 2) and headings (M,) at arc lengths (M,) [m]; a closed path returns to the first.

    It is a `PathBatch` of one, which is for many robots at once.
    """

    points_m: np.ndarray
    headings_rad: np.ndarray
    arc_m: np.ndarray
    closed: bool
    length_m: float

    @classmethod
    def from_beziers(
        cls, curves: Sequence[np.ndarray], spacing_m: float = SPACING_M, closed: bool = False
    ) -> Path:
        """A path along cubic Beziers, each (4, 2) [m], that follow one another.

        The points lie on the curves, at most about ``spacing_m`` apart. PlanError without curves,
        or with a gap of more than `MAX_GAP_M` between two of them.
        """
        control = _chain(curves, closed)
        t = np.linspace(0.0, 1.0, _SAMPLES + 1)
        dense = bezier_points(control[:, None], t)
        chords = np.hypot(*np.moveaxis(np.diff(dense, axis=1), -1, 0)).ravel()
        arc = np.concatenate(([0.0], np.cumsum(chords)))
        length_m = float(arc[-1])
        segments = max(int(np.ceil(length_m / spacing_m - 1e-6)), 3 if closed else 1)
        arc_m = np.arange(segments if closed else segments + 1) * (length_m / segments)
        along = np.interp(arc_m, arc, np.arange(len(arc)) / _SAMPLES)
        curve_of = np.minimum(along.astype(int), len(control) - 1)
        points = bezier_points(control[curve_of], along - curve_of)
        tangents = bezier_tangents(control[curve_of], along - curve_of)
        headings = np.arctan2(tangents[:, 1], tangents[:, 0])
        return cls(points, headings, arc_m, closed, length_m)

    def project(self, x_m: float, y_m: float, hint: Optional[int] = None) -> PathPosition:
        """The nearest point of the path to a position in the world.

        ``hint`` is the ``index`` of the last call: the search then follows the path from there, in
        time that does not depend on its length. Without it the whole path is searched.
        """
        hints = np.array([NO_HINT if hint is None else hint])
        found = self.batch.project(np.array([[x_m, y_m]]), hints)
        return PathPosition(**{name: column.item() for name, column in vars(found).items()})

    def pose_at(self, arc_m: float) -> Pose:
        """Of a robot on the path, after ``arc_m``; an open path goes on straight at its ends."""
        where = np.array([[arc_m]])
        x_m, y_m = self.batch.points_at(where)[0, 0]
        heading = self.batch.headings_at(where)[0, 0]
        return Pose(float(x_m), float(y_m), float(heading))

    @cached_property
    def segments(self) -> np.ndarray:
        """What a `PathBatch` keeps: between two points each; a closed path returns to its first."""
        starts = np.arange(len(self.points_m) - (0 if self.closed else 1))
        ends = (starts + 1) % len(self.points_m)
        vector = self.points_m[ends] - self.points_m[starts]
        heading = self.headings_rad[starts]
        turn = np.asarray(wrap_angle(self.headings_rad[ends] - heading))
        inverse = 1.0 / np.maximum((vector**2).sum(axis=1), np.finfo(float).tiny)
        return np.column_stack((self.points_m[starts], vector, inverse, heading, turn))

    @cached_property
    def batch(self) -> PathBatch:
        """This path as a batch of one."""
        return PathBatch((self,))


def lane_loop(road_map: RoadMap, outer: bool = True) -> Path:
    """The closed outer lane of a ring of road (driven counter-clockwise), or the inner one.

    Of several rings the one with the longest lane is taken. MapError where the road has a junction
    or an end, so that no lane closes by itself.
    """
    junction = next((tile for tile in road_map.road_tiles if tile.is_junction), None)
    if junction is not None:
        raise MapError(
            f"{road_map.name}: expected a ring of road without junctions, got {junction.kind} at "
            f"row {junction.row}, column {junction.column}; plan a route with "
            "robot.navigation.planner.plan_path, or use a ring such as the shipped map loop"
        )
    loops = _loops(road_map.lanes, road_map.tile_size_m)
    if not loops:
        raise MapError(
            f"{road_map.name}: expected a closed ring of road, but every lane leads off the road; "
            "use a ring such as the shipped map loop"
        )
    paths = [
        Path.from_beziers([lane.control_points_m for lane in loop], closed=True) for loop in loops
    ]
    longest = max(range(len(loops)), key=lambda i: paths[i].length_m)
    ring = _tiles(loops[longest])
    both = [path for path, loop in zip(paths, loops) if _tiles(loop) == ring]
    return (max if outer else min)(both, key=lambda path: path.length_m)


def _loops(lanes: Sequence[Lane], tile_size_m: float) -> List[List[Lane]]:
    """The closed chains of lanes, where at most one lane begins at a point."""
    beginning = {border_point(lane.control_points_m[0], tile_size_m): lane for lane in lanes}
    loops = []
    while beginning:
        start = place = next(iter(beginning))
        chain = []
        while place in beginning:
            chain.append(beginning.pop(place))
            place = border_point(chain[-1].control_points_m[3], tile_size_m)
        if place == start:
            loops.append(chain)
    return loops


def _tiles(loop: Sequence[Lane]) -> FrozenSet[Tuple[int, int]]:
    return frozenset((lane.tile_row, lane.tile_column) for lane in loop)


def _chain(curves: Sequence[np.ndarray], closed: bool) -> np.ndarray:
    """The control points (C, 4, 2) of curves that follow one another."""
    if not len(curves):
        raise PlanError("expected at least one Bezier to make a path of, got none")
    control = np.array(curves, dtype=float)
    gaps_m = np.hypot(*(np.roll(control[:, 0], -1, axis=0) - control[:, 3]).T)
    far = np.flatnonzero((gaps_m if closed else gaps_m[:-1]) > MAX_GAP_M)
    if len(far):
        raise PlanError(
            "expected Beziers that follow one another, got a gap of "
            f"{gaps_m[far[0]]:.3f} m after number {far[0]}; order them along the path"
        )
    return control
