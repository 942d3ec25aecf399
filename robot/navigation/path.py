"""What robots should drive along: points evenly spaced by arc length, for one or many at once.

And what that looks like from the robot, as ten angles: ``path_input``. Paper A, section 3.3: the
angles to the ten nearest points ahead on the path, between -45 and 45 degrees, normalised. A policy
for navigation gets them beside the picture.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import Any, Dict, FrozenSet, List, NamedTuple, Optional, Sequence, Tuple

import numpy as np

from robot.contract import PATH_ANGLE_LIMIT_RAD, PATH_POINTS
from robot.errors import MapError, PlanError
from robot.geometry import Pose, bezier_points, bezier_tangents, wrap_angle
from robot.navigation.road_map import Lane, RoadMap, Tile, border_point

SPACING_M = 0.02
MAX_GAP_M = 0.02  # between the end of one Bezier and the start of the next
NO_HINT = -1  # in an array of hints: search the whole path
_SAMPLES = 128  # per Bezier, to measure arc length
_REACH = 16  # segments searched on either side of a hint; the search moves on while it improves
# What a segment holds: start x, y; vector x, y; 1 / squared length; heading at its start; its turn.
_X, _DX, _INVERSE, _HEADING, _TURN, _WIDTH = 0, 2, 4, 5, 6, 7


class PathPosition(NamedTuple):
    """Where a position lies on a path; of N robots each is an array (N,)."""

    index: Any  # of the nearest segment: the hint for the next call
    arc_m: Any  # length of the path up to the nearest point
    offset_m: Any  # distance from the path, positive to the left
    heading_rad: Any  # of the path there


@dataclass(frozen=True, eq=False)
class Path:
    """Points (M, 2), headings (M,) at arc lengths (M,) [m]; a closed path returns to its first."""

    points_m: np.ndarray
    headings_rad: np.ndarray
    arc_m: np.ndarray
    closed: bool
    length_m: float

    @classmethod
    def from_beziers(cls, curves: Sequence[np.ndarray], closed: bool = False) -> "Path":
        """A path along cubic Beziers, each (4, 2) [m], that follow one another.

        Points are `SPACING_M` apart at most. PlanError: no curves, or a gap above `MAX_GAP_M`.
        """
        if not len(curves):
            raise PlanError("expected at least one Bezier to make a path of, got none")
        control = np.array(curves, dtype=float)  # (C, 4, 2)
        gaps_m = np.hypot(*(np.roll(control[:, 0], -1, axis=0) - control[:, 3]).T)
        far = np.flatnonzero((gaps_m if closed else gaps_m[:-1]) > MAX_GAP_M)
        if len(far):
            raise PlanError(
                "expected Beziers that follow one another, got a gap of "
                f"{gaps_m[far[0]]:.3f} m after number {far[0]}; order them along the path"
            )
        dense = bezier_points(control[:, None], np.linspace(0.0, 1.0, _SAMPLES + 1))
        chords = np.hypot(*np.moveaxis(np.diff(dense, axis=1), -1, 0)).ravel()
        arc = np.concatenate(([0.0], np.cumsum(chords)))
        length_m = float(arc[-1])
        segments = max(int(np.ceil(length_m / SPACING_M - 1e-6)), 3 if closed else 1)
        arc_m = np.arange(segments if closed else segments + 1) * (length_m / segments)
        along = np.interp(arc_m, arc, np.arange(len(arc)) / _SAMPLES)
        curve_of = np.minimum(along.astype(int), len(control) - 1)
        points = bezier_points(control[curve_of], along - curve_of)
        tangents = bezier_tangents(control[curve_of], along - curve_of)
        return cls(points, np.arctan2(tangents[:, 1], tangents[:, 0]), arc_m, closed, length_m)

    def project(self, x_m: float, y_m: float, hint: Optional[int] = None) -> PathPosition:
        """The nearest point to a position in the world; ``hint`` as of `PathBatch.project`."""
        hints = np.array([NO_HINT if hint is None else hint])
        found = self.batch.project(np.array([[x_m, y_m]]), hints)
        return PathPosition(*(column.item() for column in found))

    def pose_at(self, arc_m: float) -> Pose:
        """Of a robot on the path, after ``arc_m``; an open path goes on straight at its ends."""
        where = np.array([[arc_m]])
        x_m, y_m = self.batch.points_at(where)[0, 0]
        return Pose(float(x_m), float(y_m), float(self.batch.headings_at(where)[0, 0]))

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
    def batch(self) -> "PathBatch":
        """This path as a batch of one."""
        return PathBatch((self,))


class PathBatch:
    """N robots on one shared path, or each on a path of its own, padded to the longest.

    ``path_of`` (N,) is the path of every robot. Without it robot i is on path i, and where there is
    only one path all robots are on it.
    """

    def __init__(self, paths: Sequence[Path], path_of: Optional[np.ndarray] = None) -> None:
        count = len(paths)
        self._path_of = np.arange(count) if path_of is None else np.array(path_of, dtype=int)
        self._shared = path_of is None and count == 1
        self._segments = np.zeros((count, max(len(p.headings_rad) for p in paths), _WIDTH))
        self._counts = np.zeros(count, dtype=int)
        self._steps_m = np.zeros(count)
        self._closed = np.zeros(count, dtype=bool)
        for i, path in enumerate(paths):
            self.replace(i, path)

    def replace(self, path_index: int, path: Path) -> None:
        """Put another path in the place of one, as when a robot gets a new destination."""
        segments = path.segments
        count, room = len(segments), self._segments.shape[1]
        if count > room:
            self._segments = np.pad(self._segments, ((0, 0), (0, count - room), (0, 0)))
        self._segments[path_index, :count] = segments
        self._counts[path_index] = count
        self._steps_m[path_index] = path.length_m / count
        self._closed[path_index] = path.closed

    @property
    def length_m(self) -> np.ndarray:
        """Length of every path (P,)."""
        return self._counts * self._steps_m

    def project(self, xy_m: np.ndarray, hint: Optional[np.ndarray] = None) -> PathPosition:
        """The nearest point of each robot's path to its position (N, 2) in the world.

        ``hint`` (N,) is the ``index`` of the last call, `NO_HINT` where there is none. With a hint
        the search follows the path from there, so that a crossing path does not distract it; its
        time does not depend on the path's length.
        """
        xy_m = np.asarray(xy_m, dtype=float)
        paths = self._paths(len(xy_m))
        hint = np.full(len(xy_m), NO_HINT) if hint is None else np.asarray(hint)
        index = np.minimum(hint, self._counts[paths] - 1)
        fraction = np.zeros(len(xy_m))
        lost, todo = np.flatnonzero(index < 0), np.flatnonzero(index >= 0)
        if len(lost):
            everything = np.arange(self._counts[paths[lost]].max())
            window = np.minimum(everything, self._counts[paths[lost], None] - 1)
            best, fraction[lost] = self._nearest(xy_m[lost], paths[lost], window)
            index[lost] = window[np.arange(len(lost)), best]
        for _ in range(int(self._counts.max()) // _REACH + 2):
            if not len(todo):
                break
            window = self._window(paths[todo], index[todo])
            best, fraction[todo] = self._nearest(xy_m[todo], paths[todo], window)
            index[todo] = window[np.arange(len(todo)), best]
            ends = (index[todo] == 0) | (index[todo] == self._counts[paths[todo]] - 1)
            todo = todo[((best == 0) | (best == 2 * _REACH)) & (self._closed[paths[todo]] | ~ends)]
        segment = self._of(paths, index)
        vector, delta = segment[:, _DX:_INVERSE], xy_m - segment[:, _X:_DX]
        cross = vector[:, 0] * delta[:, 1] - vector[:, 1] * delta[:, 0]
        arc_m = (index + fraction) * self._steps_m[paths]
        offset_m = cross * np.sqrt(segment[:, _INVERSE])
        return PathPosition(index, arc_m, offset_m, self._heading(segment, fraction))

    def points_at(self, arc_m: np.ndarray) -> np.ndarray:
        """Points (N, K, 2) at arc lengths (N, K) [m]; an open path goes on straight at its ends."""
        paths = self._paths(len(arc_m))
        index, fraction = self._locate(paths, arc_m)
        segment = self._of(paths[:, None], index)
        inside = np.clip(fraction, 0.0, 1.0)
        points = segment[..., _X:_DX] + inside[..., None] * segment[..., _DX:_INVERSE]
        beyond_m = (fraction - inside) * self._steps_m[paths, None]
        if beyond_m.any():
            heading = self._heading(segment, inside)
            points += beyond_m[..., None] * np.stack((np.cos(heading), np.sin(heading)), axis=-1)
        return points

    def headings_at(self, arc_m: np.ndarray) -> np.ndarray:
        """Headings (N, K) [rad] at arc lengths (N, K) [m]."""
        paths = self._paths(len(arc_m))
        index, fraction = self._locate(paths, arc_m)
        return self._heading(self._of(paths[:, None], index), np.clip(fraction, 0.0, 1.0))

    def index_at(self, arc_m: np.ndarray) -> np.ndarray:
        """The hints (N,) of robots that are known to be at arc lengths (N,) [m]."""
        return np.asarray(self._locate(self._paths(len(arc_m)), arc_m[:, None])[0][:, 0])

    def advance_m(self, before_m: np.ndarray, after_m: np.ndarray) -> np.ndarray:
        """Progress (N,) from one arc length to another, the short way round on a closed path."""
        paths = self._paths(len(after_m))
        length_m = self.length_m[paths]
        gain_m = np.asarray(after_m) - before_m
        round_m = (gain_m + 0.5 * length_m) % length_m - 0.5 * length_m
        return np.where(self._closed[paths], round_m, gain_m)

    def _paths(self, robots: int) -> np.ndarray:
        return np.zeros(robots, dtype=int) if self._shared else self._path_of

    def _of(self, paths: np.ndarray, index: np.ndarray) -> np.ndarray:
        """Segments (..., 7): ``take`` is several times as fast as indexing."""
        every = self._segments.reshape(-1, _WIDTH)
        return every.take(paths * self._segments.shape[1] + index, axis=0)

    def _window(self, paths: np.ndarray, centre: np.ndarray) -> np.ndarray:
        """Segment indices (N, 2 * _REACH + 1) around a centre, on the path."""
        window = centre[:, None] + np.arange(-_REACH, _REACH + 1)
        counts = self._counts[paths, None]
        return np.where(self._closed[paths, None], window % counts, np.clip(window, 0, counts - 1))

    def _nearest(
        self, xy_m: np.ndarray, paths: np.ndarray, window: np.ndarray
    ) -> Tuple[np.ndarray, np.ndarray]:
        """Column (N,) of the nearest segment of each window (N, W), and how far along it."""
        segment = self._of(paths[:, None], window)
        vector = segment[..., _DX:_INVERSE]
        delta = xy_m[:, None] - segment[..., _X:_DX]
        along = delta[..., 0] * vector[..., 0] + delta[..., 1] * vector[..., 1]
        along = np.clip(along * segment[..., _INVERSE], 0.0, 1.0)
        delta = delta - along[..., None] * vector
        best = (delta[..., 0] ** 2 + delta[..., 1] ** 2).argmin(axis=1)
        return best, along[np.arange(len(best)), best]

    def _locate(self, paths: np.ndarray, arc_m: np.ndarray) -> Tuple[np.ndarray, np.ndarray]:
        """Segment and fraction along it (outside 0 to 1 beyond an open path) of arc lengths."""
        counts, steps_m = self._counts[paths, None], self._steps_m[paths, None]
        along = np.asarray(arc_m, dtype=float) / steps_m
        along = np.where(self._closed[paths, None], along % counts, along)
        index = np.clip(np.floor(along).astype(int), 0, counts - 1)
        return index, along - index

    def _heading(self, segment: np.ndarray, fraction: np.ndarray) -> np.ndarray:
        return np.asarray(wrap_angle(segment[..., _HEADING] + fraction * segment[..., _TURN]))


def lane_loop(road_map: RoadMap, outer: bool = True) -> Path:
    """The closed outer lane of a ring of road (driven counter-clockwise), or the inner one.

    Of several rings the longest counts. MapError: a junction, or an end, lets no lane close.
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
    rings: Dict[FrozenSet[Tile], List[Path]] = {}  # both lanes, by their tiles
    for loop in loops:
        path = Path.from_beziers([lane.control_points_m for lane in loop], closed=True)
        rings.setdefault(frozenset(lane.tile for lane in loop), []).append(path)
    both = max(rings.values(), key=lambda paths: max(path.length_m for path in paths))
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


POINT_SPACING_M = 0.04  # along the path; ten of them reach a little farther than one tile's corner
FIRST_POINT_M = 0.06  # ahead of the robot: nearer ones swing wildly with the smallest offset
_AHEAD_M = FIRST_POINT_M + POINT_SPACING_M * np.arange(PATH_POINTS)


def path_inputs(paths: PathBatch, poses: np.ndarray, arc_m: np.ndarray) -> np.ndarray:
    """(N, PATH_POINTS) float32 in [-1, 1], nearest point first; positive is to the left.

    Of N robots at poses (N, 3), who are on their paths at ``arc_m`` (N,) of `PathBatch.project`.
    Beyond the end of an open path the points go on straight.
    """
    poses = np.asarray(poses, dtype=float)
    delta = paths.points_at(np.asarray(arc_m)[:, None] + _AHEAD_M) - poses[:, None, :2]
    c, s = np.cos(poses[:, 2:]), np.sin(poses[:, 2:])
    forward = c * delta[..., 0] + s * delta[..., 1]
    left = c * delta[..., 1] - s * delta[..., 0]
    angle = np.clip(np.arctan2(left, forward), -PATH_ANGLE_LIMIT_RAD, PATH_ANGLE_LIMIT_RAD)
    return (angle / PATH_ANGLE_LIMIT_RAD).astype(np.float32)


def path_input(path: Path, pose: Pose, hint: Optional[int] = None) -> np.ndarray:
    """The path input of one robot, (PATH_POINTS,) float32; ``hint`` as of `Path.project`."""
    arc_m = path.project(pose.x_m, pose.y_m, hint).arc_m
    return path_inputs(path.batch, np.array([pose]), np.array([arc_m]))[0]
