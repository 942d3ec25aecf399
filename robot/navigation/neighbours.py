"""What overhead poses of everybody tell one robot: its `RoadAhead`, and who is at its junctions.

All robots of an arena hear the same poses, so they agree on who came first to a junction, by the
localizer's clock, without a word between them.
"""

import math
from collections import deque
from dataclasses import replace
from typing import Callable, Deque, Dict, Iterator, Mapping, NamedTuple, Optional, Sequence, Tuple

import numpy as np

from robot.geometry import Pose
from robot.link.freshness import PoseGate
from robot.link.messages import PoseMessage, Telemetry
from robot.navigation.lane_view import LaneView
from robot.navigation.road_map import ORIENTATIONS, RoadMap, Tile
from robot.safety.governors import NOSE_M
from robot.safety.road_ahead import AtJunction, Junction, RoadAhead

HALF_ROBOT_M, HALF_DUCK_M = 0.09, 0.035
AHEAD_M = 0.02 * np.arange(61)  # along the lane, from the axle: where it is looked at
_NEAR_M = 1.6  # farther off nobody is on that way
_TAIL_M = 0.1  # of a robot, behind its axle
_HALF_WIDE_M = 0.08
_RETURN_M = 0.6  # in which a robot that heads elsewhere gets back to the middle of its lane
_WALKS_S = (0.0, 0.4, 0.8, 1.2)  # who walks counts where it will be, too
_IN_FRONT_M = 0.03
_SWING_M = 0.09  # deviation of whether it comes to who stands beside its lane
STILL_MPS = 0.05  # poses of who stands move, too
_AT_LINE_M = 0.12  # so near to the line its nose stands who has arrived
_OVER_M = 0.02  # so far beyond it is inside
_STANDS_S = 15.0  # who stands inside for longer is in the way, not on its way over


class Other(NamedTuple):
    """Somebody else on the road, from above."""

    x_m: float
    y_m: float
    vx_mps: float = 0.0
    vy_mps: float = 0.0
    half_m: float = HALF_ROBOT_M  # from its middle to its edge
    walks: bool = False  # it crosses lanes; robots keep to theirs


def free_way(
    lane_m: np.ndarray, pose: Pose, others: Sequence[Other], sigma_m: float = 0.0
) -> RoadAhead:
    """What is left of the way along a lane, whose points (61, 2) lie `AHEAD_M` from the robot.

    Who is a little behind the robot's axle by places that err by ``sigma_m`` may be before it.
    """
    seen = np.array(others, dtype=float).reshape(-1, 6)
    seen = seen[np.hypot(seen[:, 0] - pose.x_m, seen[:, 1] - pose.y_m) < _NEAR_M]
    if not len(seen):
        return RoadAhead()
    way_m = _way_back(lane_m, pose)
    moving = (np.hypot(seen[:, 2], seen[:, 3]) > STILL_MPS) & (seen[:, 5] > 0.0)
    nearest = RoadAhead()
    for after_s in _WALKS_S:
        here = seen if after_s == 0.0 else seen[moving]
        at_m = here[:, :2] + after_s * here[:, 2:4]
        apart_m = np.linalg.norm(at_m[:, None] - way_m, axis=-1)  # (O, 61)
        near = apart_m < _HALF_WIDE_M + here[:, 4:5]
        first, where = near.argmax(axis=1), apart_m.argmin(axis=1)
        # In a bend it comes near to things long before it would be abreast of them.
        most_m = np.minimum(AHEAD_M[first] + _HALF_WIDE_M, AHEAD_M[where] - here[:, 4]) - NOSE_M
        on_it = near.any(axis=1) & (pose.to_robot(at_m)[:, 0] > _IN_FRONT_M - 2.0 * sigma_m)
        kept_m = np.linalg.norm(at_m[:, None] - lane_m, axis=-1).min(axis=1)
        still = np.hypot(here[:, 2], here[:, 3]) <= STILL_MPS
        beside = still & (kept_m >= _HALF_WIDE_M + here[:, 4])  # of the lane
        away_m = np.hypot(*(at_m - pose[:2]).T) - here[:, 4] - NOSE_M
        most_m = np.where(beside, away_m, most_m)
        for k in np.flatnonzero(on_it & (most_m < nearest.free_m)).tolist():
            if most_m[k] < nearest.free_m:
                step = np.diff(way_m[min(where[k], 59) :][:2], axis=0)[0]
                along = float(here[k, 2:4] @ step) / max(float(np.hypot(*step)), 1e-9)
                nearest = RoadAhead(float(most_m[k]), _SWING_M * bool(beside[k]), -along)
    return nearest


def _way_back(lane_m: np.ndarray, pose: Pose) -> np.ndarray:
    """(61, 2) how the robot goes on: along its lane, and within `_RETURN_M` to the middle of it."""
    steps = np.diff(lane_m, axis=0)
    along = steps / np.maximum(np.hypot(steps[:, :1], steps[:, 1:]), 1e-9)
    along = np.concatenate((along, along[-1:]))
    left = np.stack((-along[:, 1], along[:, 0]), axis=1)
    ahead = np.array((math.cos(pose.heading_rad), math.sin(pose.heading_rad)))
    aside_m = left[0] @ (np.array(pose[:2]) - lane_m[0]) + AHEAD_M * (left[0] @ ahead)
    return lane_m + (aside_m * np.maximum(1.0 - AHEAD_M / _RETURN_M, 0.0))[:, None] * left


class Traveller(NamedTuple):
    """A robot, as it is seen."""

    pose: Pose
    speed_mps: float
    line_m: float  # from its nose to the next red line
    stands_s: float = 0.0  # for so long


class Crossings:
    """Who stands at the junctions of a map since when, and who is inside."""

    def __init__(self, road_map: RoadMap) -> None:
        self._map = road_map
        self._known: Dict[str, Tuple[Tile, AtJunction]] = {}

    def update(self, now_s: float, robots: Mapping[str, Traveller]) -> Dict[str, Junction]:
        """By name, the junctions of those who stand at one or are inside."""
        asked = {name: self._at(now_s, name, robot) for name, robot in robots.items()}
        self._known = found = {name: at for name, at in asked.items() if at is not None}
        return {
            name: Junction(own, tuple(o for n, (t, o) in found.items() if t == tile and n != name))
            for name, (tile, own) in found.items()
        }

    def _at(self, now_s: float, name: str, robot: Traveller) -> Optional[Tuple[Tile, AtJunction]]:
        before = self._known.get(name)
        inside = self.inside(robot.pose)
        if inside is not None:
            if robot.stands_s > _STANDS_S:
                return None
            if before is not None and before[0] == inside:
                return inside, replace(before[1], inside=True)
            return inside, AtJunction(_arm(robot.pose), now_s, name, inside=True)
        if not robot.line_m <= _AT_LINE_M or (before is None and robot.speed_mps > STILL_MPS):
            return None
        here, heads = self._map.tile_at(robot.pose.x_m, robot.pose.y_m), _arm(robot.pose) + 2
        tile = here and self._map.beyond(here, ORIENTATIONS[heads % 4])
        since_s = before[1].arrived_s if before is not None else now_s
        return None if tile is None else (tile, AtJunction(_arm(robot.pose), since_s, name))

    def inside(self, pose: Pose) -> Optional[Tile]:
        """The junction that any part of a robot is in."""
        parts = np.array(((NOSE_M - _OVER_M, 0.0), (0.0, 0.0), (-_TAIL_M, 0.0)))
        tiles = (self._map.tile_at(x_m, y_m) for x_m, y_m in pose.to_world(parts).tolist())
        return next((tile for tile in tiles if tile is not None and tile.is_junction), None)


def _arm(pose: Pose) -> int:
    """The side, of `ORIENTATIONS`, from which a robot with this heading comes into a junction."""
    return (round(pose.heading_rad / (0.5 * math.pi)) - 1) % 4


DUCK = "duck"  # so begin the names of what is small and walks; all others are robots
SIGMA_M = 0.03  # of overhead poses, standard deviation
HEARD_S = 1.0  # poses older than that tell nothing of the road
REMEMBERED_S = 5.0  # who is seen no longer counts where it was, and where it may be by now
_GOES_ON_S = 1.0  # as it went
_MOVED_M = 0.2  # poses of standing robots move by less
_SPAN_S = 0.5  # over which a speed is meant


class Neighbours:
    """The others on the map of a view, for the robot of this name.

    Where nothing was heard for `HEARD_S`, nobody knows what is on the road: it tells NaN, before
    which a robot stands. ``sigma_m``: of the poses [m].
    """

    def __init__(self, view: LaneView, robot: str, sigma_m: float = SIGMA_M) -> None:
        self._view, self._robot, self._sigma_m = view, robot, sigma_m
        self._crossings = Crossings(view.road_map)
        self._tracks: Dict[str, _Track] = {}
        self._junction: Optional[Junction] = None
        self._heard_s = -math.inf

    def hear(self, poses: Sequence[PoseMessage], now_s: float) -> None:
        """Take in the poses of one picture: everybody's, one's own among them."""
        self._heard_s = max((self._heard_s, *self._take(poses, now_s).values()))

    def _take(self, poses: Sequence[PoseMessage], now_s: float) -> Dict[str, float]:
        """By name, when those were there that could be true."""
        taken = {}
        for pose in poses:
            track = self._tracks.setdefault(pose.robot, _Track(pose.robot))
            if track.take(pose, now_s):
                taken[pose.robot] = track.at_s
        if taken and self._view.junctions:
            known = [name for name in self._known(now_s) if not name.startswith(DUCK)]
            robots = {name: self._traveller(name) for name in known if self._tracks[name].headed}
            self._junction = self._crossings.update(poses[0].t_capture_s, robots).get(self._robot)
        return taken

    def ahead(self, now_s: float, pose: Pose, way_m: np.ndarray) -> RoadAhead:
        """What lies before the robot at a pose, on its way (61, 2) [m] of `AHEAD_M`."""
        if not now_s - self._heard_s <= HEARD_S:
            return RoadAhead(free_m=math.nan)
        way = free_way(way_m, pose, list(self._others(now_s)), self._sigma_m)
        junction = self._junction
        if junction is not None and self._crossings.inside(pose) is None:
            junction = replace(junction, own=replace(junction.own, inside=False))
        return replace(way, free_sigma_m=max(way.free_sigma_m, self._sigma_m), junction=junction)

    def _known(self, now_s: float) -> Iterator[str]:
        """Who was seen lately."""
        return (n for n, each in self._tracks.items() if now_s - each.at_s <= REMEMBERED_S)

    def _others(self, now_s: float) -> Iterator[Other]:
        """Where they were seen, and where they are if they went on."""
        for name in self._known(now_s):
            if name != self._robot:
                track, duck = self._tracks[name], name.startswith(DUCK)
                vx_mps, vy_mps = track.velocity_mps
                half_m = HALF_DUCK_M if duck else HALF_ROBOT_M
                for after_s in (0.0, min(now_s - track.at_s, _GOES_ON_S)):
                    x_m, y_m = track.pose.x_m + after_s * vx_mps, track.pose.y_m + after_s * vy_mps
                    yield Other(x_m, y_m, vx_mps, vy_mps, half_m, duck)

    def _traveller(self, name: str) -> Traveller:
        track = self._tracks[name]
        line_m = self._view.line_ahead_m(track.pose) - NOSE_M
        speed_mps = math.hypot(*track.velocity_mps)
        return Traveller(track.pose, speed_mps, line_m, track.at_s - track.moved_s)


BELIEVED_M = 0.05  # standard deviation of what a robot tells of its place
KNOWN_M = 0.125  # 95 % sure of it, as by a person's word: who is less sure tells nothing,
STANDS_KNOWN_M, STANDS_S = 0.25, 5.0  # unless it has stood for so long: nobody may wait for it then
Reports = Mapping[str, Callable[[], Optional[Telemetry]]]


class Company(Neighbours):
    """`Neighbours` as they tell themselves; all must be heard, or nobody knows what is on the road.

    Robots without a localizer tell each other over the link where they believe to be. ``reports``:
    by name, what gives another robot's newest one, or None, and never blocks.
    """

    def __init__(self, view: LaneView, robot: str, reports: Reports) -> None:
        super().__init__(view, robot, BELIEVED_M)
        self._reports, self._turns = reports, 0
        self._above: Sequence[PoseMessage] = ()
        self._said_s = dict.fromkeys(reports, -math.inf)

    def hear(self, poses: Sequence[PoseMessage], now_s: float) -> None:  # noqa: ARG002
        """Those who do not tell of themselves: of the others everybody would be told of twice."""
        tell = (self._robot, *self._reports)
        self._above = [pose for pose in poses if pose.robot not in tell]

    def ahead(self, now_s: float, pose: Pose, way_m: np.ndarray) -> RoadAhead:
        """As of `Neighbours`, by what has been said up to now."""
        self._turns += 1
        told = [PoseMessage(self._robot, *pose, 1.0, now_s, "own", self._turns, now_s)]
        long_m = {self._robot: 0.0}
        for name, receive in self._reports.items():
            said = receive()
            if said is None or said.pose is None or said.belief is None or said.robot != name:
                continue
            long_m[name] = said.belief.long_m
            if long_m[name] <= STANDS_KNOWN_M:
                stamp = said.session, said.sequence, said.t_sent_s
                told.append(PoseMessage(name, *said.pose, 1.0, said.t_sent_s, *stamp))
        for name, at_s in self._take([*told, *self._above], now_s).items():
            track = self._tracks[name]
            stands = math.hypot(*track.velocity_mps) <= STILL_MPS
            stands &= at_s - track.moved_s > STANDS_S
            if name in long_m and (long_m[name] <= KNOWN_M or stands):
                self._said_s[name] = at_s
        self._heard_s = min(self._said_s.values(), default=now_s)
        return super().ahead(now_s, pose, way_m)


class _Track:
    """One of them: its newest pose, when that was [s], and how fast it went [m/s]."""

    def __init__(self, name: str) -> None:
        self.pose, self.at_s, self.velocity_mps = Pose(0.0, 0.0, 0.0), -math.inf, (0.0, 0.0)
        self.headed = False  # its heading was seen once, at least
        self.moved_s, self._stood = -math.inf, self.pose  # when and where it moved, or came back
        self._gate = PoseGate(name)
        self._places: Deque[Tuple[float, Pose]] = deque()

    def take(self, message: PoseMessage, now_s: float) -> bool:
        """Whether it could be true; what jumps is believed once it could have driven there."""
        if not self._gate.take(message, now_s):
            return False
        self.at_s = now_s - self._gate.stream.age_s(now_s)
        self.pose = Pose(message.x_m, message.y_m, self.pose.heading_rad)
        if message.heading_rad is not None:
            self.headed, self.pose = True, self.pose._replace(heading_rad=message.heading_rad)
        self._places.append((self.at_s, self.pose))
        while self.at_s - self._places[0][0] > _SPAN_S + 1e-6:
            self._places.popleft()
        since_s, began = self._places[0]
        for_s = max(self.at_s - since_s, _SPAN_S)
        self.velocity_mps = (self.pose.x_m - began.x_m) / for_s, (self.pose.y_m - began.y_m) / for_s
        if len(self._places) == 1 or math.dist(self.pose[:2], self._stood[:2]) > _MOVED_M:
            self.moved_s, self._stood = self.at_s, self.pose
        return True
