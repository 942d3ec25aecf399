"""Where am I? Hypotheses all over a map's lanes, of which driving and looking leaves one.

Each hypothesis is a filter of its own (`robot.navigation.fusion`), moved by the wheels' steps and
corrected by sight; besides, it is weighed by how well the map there explains what is seen: a road,
its curvature, the red line, and the junction's kind (multiple hypothesis localisation: Jensfelt and
Kristensen, IEEE Transactions on Robotics and Automation 17, 2001). The likeliest may be elsewhere
on the map, but the road there is as the one that is seen: along that the robot drives on.
"""

import math
from typing import List, NamedTuple, Optional, Tuple

import numpy as np

from robot.errors import PlanError
from robot.geometry import Pose, bezier_points, bezier_tangents, wrap_angle
from robot.navigation.fusion import FusionConfig, PoseFusion
from robot.navigation.lane_view import KINDS, LaneAhead, LaneView
from robot.navigation.path import Path, PathPosition
from robot.navigation.planner import RIGHT_RAD, STRAIGHT_RAD, LaneGraph, path_on
from robot.navigation.sight_fix import SightFix
from robot.vision.sight import Seen

_APART_M = 0.2  # between hypotheses on a lane, at first
_FIRST = (0.08, 0.05, 0.2)  # their deviations: along the lane, beside it [m], of the heading
_AT_ONCE = 24  # that look at one picture; the others look at the next
_BEST = 8  # that look at every picture: the robot drives on by one of them
_SHARE = 0.2  # of what a picture tells, at most: rivals look at different ones,
_ALIKE_M = 0.3  # and pictures err alike over so much driving
_LEAST = 0.03  # of any probability: sight errs
_NO_ROAD = 4.0  # against a hypothesis beside the road, of a picture that shows one
_WORST = 4.5  # of a figure's half squared error
_LINE_SEEN_M, _LINE_NEAR_M = (0.12, 0.45), (0.05, 0.6)  # as sight was taught
_CURVATURE_PM = 0.5  # deviation of the map's curvature ahead
_GIVEN_UP = math.log(1e-6)  # weight below the best one's
_STEP_M = 0.02  # between pictures: who stands sees nothing new
_SAME_M, _SAME_RAD = 0.25, 0.6
_TWIN_M, _TWIN_RAD = 0.05, 0.3
_SURE = 0.995  # share of the weight that is the place
_DRIVEN_M = 0.5  # before which nobody is asked
_WITHIN_M = 0.12  # how well the place is known
_JUNCTIONS = 3  # that it crosses by itself, at most,
_BEFORE_M = 0.3  # then it stands before the next one's line,
_FARTHEST_M = 15.0  # and after so much driving
_NOW = 4.0  # what the newest picture counts, when one is chosen to drive on by
_BETTER = 4.0  # than the one of before
_LIKE_M, _LIKE_RAD = 0.05, 0.35  # its lane lies as the one that is seen
_LOST_S = 0.5  # without a picture that fits: it does not cross the junction that it was in
_SEEN_S = 1.0  # a lane counts as seen for so long: over the middle of a junction
_KIND_SHARE = 0.3  # of a picture, in what the junction ahead is taken for
_NO_TEE = 0.1  # probability with which a junction may be a T, and is taken straight on
_SHOWN_M, _LEFT_M = 1.2, 0.6  # of the way when it is laid, and before it is laid anew
_LOOKING = FusionConfig(sight=True, seen_line=1e-3)  # red lines tell the place, not the camera

# The place that is left: pose, and deviations of x [m], y [m] and heading [rad].
Place = Tuple[Pose, Tuple[float, float, float]]


class On(NamedTuple):
    """A way on, and where a robot is on it."""

    path: Path
    pose: Pose
    at: PathPosition
    seen: bool  # whether pictures showed a lane there of late


class WayOn:
    """The way on of one robot on the map of a graph, laid anew before it ends."""

    def __init__(self, graph: LaneGraph) -> None:
        self.toward_rad = STRAIGHT_RAD  # at junctions
        self._graph = graph
        self._path: Optional[Path] = None

    def lay(self, pose: Pose) -> Optional[Path]:
        """Anew, from a pose on; None off the road."""
        try:
            self._path = path_on(self._graph, pose, _SHOWN_M, self.toward_rad)
        except PlanError:
            self._path = None
        return self._path

    def on(self, fix: SightFix, now_s: float, robot: int = 0) -> Optional[On]:
        """The way of a robot whose place a filter knows; None off the road."""
        pose = Pose(*fix.fusion.poses[robot].tolist())
        path = self._path
        if path is None or path.length_m - path.project(pose.x_m, pose.y_m).arc_m < _LEFT_M:
            path = self.lay(pose)
        if path is None:
            return None
        at = path.project(pose.x_m, pose.y_m)
        return On(path, pose, at, now_s - float(fix.took_s[robot]) <= _SEEN_S)


class Whereabouts:
    """Looks for a robot's place on the map of a graph, and meanwhile drives on."""

    def __init__(self, graph: LaneGraph, view: LaneView) -> None:
        self._view = view
        found = []
        for lane in graph.lanes:  # poses along it
            control = lane.control_points_m
            count = max(1, round(float(np.hypot(*(control[3] - control[0]))) / _APART_M))
            t = (np.arange(count) + 0.5) / count
            headings = np.arctan2(*bezier_tangents(control, t).T[::-1])
            found.append(np.column_stack((bezier_points(control, t), headings)))
        poses = np.concatenate(found)
        self._fusion = PoseFusion(len(poses), _LOOKING)
        self._fix = SightFix(self._fusion, [self._view] * len(poses))
        self._fusion.put(np.arange(len(poses)), poses, (_FIRST[0], _FIRST[0], _FIRST[2]))
        self._weights = np.zeros(len(poses))  # logarithms, the greatest 0
        self._alive = np.ones(len(poses), dtype=bool)
        self._turn = self.junctions = 0  # the latter crossed by hypotheses that it drove on by
        self._driven_m, self._crossing, self._vain = 0.0, False, False
        self._looked_m = np.full(len(poses), -math.inf)  # the way that each had driven then
        self.places = len(poses)  # that fit what was seen
        self._told = np.full(len(poses), -math.inf)  # of the newest picture that each looked at
        self._leader: Optional[int] = None  # as if it were there, it drives on
        self._way, self._kinds = WayOn(graph), np.zeros(len(KINDS))

    def move(self, forward_m: float, turn_rad: float, now_s: float) -> None:
        """The wheels' steps that end now; for every tick."""
        count = len(self._weights)
        self._fusion.move(np.full(count, forward_m), np.full(count, turn_rad), now_s)
        self._driven_m += abs(forward_m)

    @property
    def sentence(self) -> str:
        """How far it has come, for a person."""
        fit = "one place fits" if self.places == 1 else f"{self.places} places fit"
        ways = ["let it drive on"] * (not self._given_up)
        ways += ["drive it by hand through a junction or two"] * self._view.junctions
        told = ", or ".join([", ".join(ways)] * bool(ways) + ["say on the monitor where it stands"])
        return f"the robot seeks its place, and {fit} what it saw, not surely enough yet; {told}"

    @property
    def _given_up(self) -> bool:
        return self._vain or self._driven_m > _FARTHEST_M

    def on(self, now_s: float) -> Optional[On]:
        """The way on; None before a picture showed a road, or once it gives up."""
        if self._leader is None or self._given_up:
            return None
        return self._way.on(self._fix, now_s, self._leader)

    def see(self, seen: Seen, now_s: float) -> Tuple[Place, ...]:
        """Take what a new picture shows (N = 1); the place, once one is left."""
        if not seen.in_lane[0]:
            return ()
        stands = self._driven_m - float(self._looked_m[self._alive].min()) < _STEP_M
        turn = self._alive & ((np.cumsum(self._alive) - 1) // _AT_ONCE == self._turn) & (not stands)
        group = turn.copy()
        group[self._best()[:_BEST]] = True
        if self._leader is not None:
            group[self._leader] = True
        poses, within_m = self._fusion.poses, self._fusion.certainty[:, 0]
        for i in np.flatnonzero(group).tolist():
            road = self._view.at(*poses[i].tolist())
            self._told[i] = _likely(seen, road, 0.5 * float(within_m[i]))
        share = np.minimum(_SHARE, (self._driven_m - self._looked_m[turn]) / _ALIKE_M)
        self._weights[turn] += share * self._told[turn]
        self._looked_m[turn] = self._driven_m
        each = Seen(*(np.repeat(part, len(group), axis=0) for part in seen))
        self._fix.see(each, group, now_s)
        if stands:
            return ()
        self._lead(seen, now_s)
        self._choose(seen)
        self._turn += 1
        if self._turn * _AT_ONCE < self._alive.sum():
            return ()  # not all have looked yet
        self._turn = 0
        return self._left()

    def _best(self) -> List[int]:
        """Those that explain best what is seen now, the best first."""
        fit = np.where(self._alive, self._weights + _NOW * self._told, -math.inf)
        return [int(i) for i in np.argsort(-fit)[: int(np.isfinite(fit).sum())]]

    def _lead(self, seen: Seen, now_s: float) -> None:
        """By the best whose lane lies as the one that is seen; over junctions as it was begun."""
        fit = self._weights + _NOW * self._told
        before, took = self._leader, self._fix.took_s == now_s
        if before is not None:
            road = self._view.at(*self._fusion.poses[before].tolist())
            if road is not None and road.in_junction and now_s - self._fix.took_s[before] < _LOST_S:
                return
        for i in self._best():
            if took[i] and self._like(seen, i):
                keeps = before is not None and took[before] and fit[before] > fit[i] - _BETTER
                if not keeps and self._way.lay(Pose(*self._fusion.poses[i].tolist())):
                    self._leader, self._crossing = i, False
                return

    def _choose(self, seen: Seen) -> None:
        """Whether to go over the junction ahead, and to the right where it may rather be a T."""
        if self._leader is None:
            return
        pose = Pose(*self._fusion.poses[self._leader].tolist())
        road = self._view.at(*pose)
        crossing = road is not None and road.in_junction
        self.junctions += self._crossing and not crossing
        self._crossing = crossing
        if road is None or road.in_junction:
            return
        self._vain = self.junctions >= _JUNCTIONS and road.line_m < _BEFORE_M
        self._kinds += _KIND_SHARE * (seen.junction[0] - self._kinds)
        tee, left = self._kinds[KINDS.index("tee")], self._kinds[KINDS.index("left")]
        toward_rad = RIGHT_RAD if tee > max(left, _NO_TEE) else STRAIGHT_RAD
        if toward_rad != self._way.toward_rad:
            self._way.toward_rad = toward_rad
            self._way.lay(pose)

    def _like(self, seen: Seen, i: int) -> bool:
        """Whether the picture shows the robot in a lane as this hypothesis is in its own."""
        road = self._view.at(*self._fusion.poses[i].tolist())
        if road is None or road.in_junction:
            return False
        beside_m, turned_rad = np.abs(seen.figures[0, :2] - (road.offset_m, road.heading_rad))
        return bool(beside_m < _LIKE_M and turned_rad < _LIKE_RAD)

    def _left(self) -> Tuple[Place, ...]:
        """The place, if only one is left; gives up what fits far worse, or is there twice."""
        poses = self._fusion.poses
        order = np.argsort(-np.where(self._alive, self._weights, -math.inf))
        order = order[: int(self._alive.sum())]
        self._weights -= self._weights[order[0]]
        self._alive[:] = False
        shares = np.zeros(len(order))  # of the places, the likeliest first
        heads: List[int] = []
        for i in order[self._weights[order] > _GIVEN_UP].tolist():
            apart = np.abs(poses[heads] - poses[i])
            turned = np.abs(np.asarray(wrap_angle(apart[:, 2])))
            far_m = np.hypot(apart[:, 0], apart[:, 1])
            self._alive[i] = not ((far_m < _TWIN_M) & (turned < _TWIN_RAD)).any()
            same = np.flatnonzero((far_m < _SAME_M) & (turned < _SAME_RAD))
            place = int(same[0]) if len(same) else len(heads)
            if not len(same):
                heads.append(i)
            shares[place] = max(shares[place], math.exp(self._weights[i]))
        self.places = int((shares > 0.05).sum())
        best = int(order[0])
        within_m, turned_rad = self._fusion.certainty[best].tolist()
        if shares[0] < _SURE * shares.sum() or within_m > _WITHIN_M or self._driven_m < _DRIVEN_M:
            return ()
        beside_m = within_m / 2.0
        return ((Pose(*poses[best].tolist()), (beside_m, beside_m, turned_rad / 2.0)),)


def _likely(seen: Seen, road: Optional[LaneAhead], along_sd_m: float) -> float:
    """Logarithm of how likely a picture is where the map shows this road."""
    if road is None:
        return -_NO_ROAD
    told = 0.0
    figures, deviations = seen.figures[0], seen.deviations[0]
    line, line_m = max(_LEAST, min(1.0 - _LEAST, float(seen.line[0]))), road.line_m
    (near, far), (nearest, farthest) = _LINE_SEEN_M, _LINE_NEAR_M
    if line_m > farthest + along_sd_m:
        told += math.log(1.0 - line)
    else:
        told += math.log(line) if near <= line_m <= far else 0.0
        variance = along_sd_m**2 + 4.0 * float(deviations[3]) ** 2
        told -= line * min(_WORST, 0.5 * float(figures[3] - line_m) ** 2 / variance)
    kinds = np.clip(seen.junction[0], _LEAST, 1.0)
    if nearest <= line_m <= farthest:
        told += math.log(kinds[road.kind])
    elif line_m > farthest + _APART_M and not road.in_junction:
        told += math.log(kinds[0])
    if math.isfinite(road.curvature_pm):
        variance = _CURVATURE_PM**2 + float(deviations[2]) ** 2 + (road.slope_pm2 * along_sd_m) ** 2
        told -= min(_WORST, 0.5 * float(figures[2] - road.curvature_pm) ** 2 / variance)
    else:
        told -= 0.5  # what a figure that is right costs on average
    for figure, expected in ((0, road.offset_m), (1, road.heading_rad)):
        variance = 4.0 * float(deviations[figure]) ** 2 + _FIRST[figure + 1] ** 2
        error = float(figures[figure]) - expected
        told -= min(_WORST, 0.5 * error**2 / variance)
    return told
