"""``Neighbours``: what overhead poses of everybody tell one robot, as its `RoadAhead`.

All robots of an arena hear the same poses, so they agree on who came first to a junction, by the
localizer's clock, without a word between them.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import replace
from typing import Deque, Dict, Iterator, Optional, Sequence, Tuple

import numpy as np

from robot.geometry import Pose
from robot.link.freshness import PoseGate
from robot.link.messages import PoseMessage
from robot.navigation.lane_view import LaneView
from robot.navigation.others import (
    HALF_DUCK_M,
    HALF_ROBOT_M,
    Crossings,
    Other,
    Traveller,
    free_way,
)
from robot.safety.governors import NOSE_M
from robot.safety.road_ahead import Junction, RoadAhead

DUCK = "duck"  # so begin the names of what is small and walks; all others are robots
SIGMA_M = 0.03  # of overhead poses, standard deviation
HEARD_S = 1.0  # poses older than that tell nothing of the road
REMEMBERED_S = 5.0  # who is seen no longer counts where it was, and where it may be by now
_GOES_ON_S = 1.0  # as it went
_SPAN_S = 0.5  # over which a speed is meant: poses of standing robots move, too


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
        taken = False
        for pose in poses:
            track = self._tracks.setdefault(pose.robot, _Track(pose.robot))
            if track.take(pose, now_s):
                taken, self._heard_s = True, max(self._heard_s, track.at_s)
        if taken and self._view.junctions:
            drive = [name for name in self._known(now_s) if self._tracks[name].headed]
            robots = {name: self._traveller(name) for name in drive}
            found = self._crossings.update(poses[0].t_capture_s, robots)
            self._junction = found.get(self._robot)

    def ahead(self, now_s: float, pose: Pose, way_m: np.ndarray) -> RoadAhead:
        """What lies before the robot at a pose, on its way (61, 2) [m] of `AHEAD_M`."""
        if not now_s - self._heard_s <= HEARD_S:
            return RoadAhead(free_m=math.nan)
        way = free_way(way_m, pose, list(self._others(now_s)), self._sigma_m)
        junction = self._junction
        if junction is not None and self._crossings.inside(pose) is None:
            junction = replace(junction, own=replace(junction.own, inside=False))
        return replace(way, free_sigma_m=self._sigma_m, junction=junction)

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
        return Traveller(track.pose, math.hypot(*track.velocity_mps), line_m)


class _Track:
    """One of them: its newest pose, when that was [s], and how fast it went [m/s]."""

    def __init__(self, name: str) -> None:
        self.pose, self.at_s, self.velocity_mps = Pose(0.0, 0.0, 0.0), -math.inf, (0.0, 0.0)
        self.headed = False  # its heading was seen once, at least
        self._gate = PoseGate(name)
        self._places: Deque[Tuple[float, Pose]] = deque()

    def take(self, message: PoseMessage, now_s: float) -> bool:
        """Whether it could be true; what jumps is believed once it could have driven there."""
        if not self._gate.take(message, now_s):
            return False
        self.at_s = now_s - self._gate.age_s(now_s)
        self.headed |= message.heading_rad is not None
        self.pose = message.pose or Pose(message.x_m, message.y_m, self.pose.heading_rad)
        self._places.append((self.at_s, self.pose))
        while self.at_s - self._places[0][0] > _SPAN_S + 1e-6:
            self._places.popleft()
        since_s, began = self._places[0]
        for_s = max(self.at_s - since_s, _SPAN_S)
        self.velocity_mps = (self.pose.x_m - began.x_m) / for_s, (self.pose.y_m - began.y_m) / for_s
        return True
