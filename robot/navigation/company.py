"""Robots without a localizer tell each other over the link where they believe to be."""

import math
from typing import Callable, List, Mapping, Optional, Sequence

import numpy as np

from robot.geometry import Pose
from robot.link.messages import PoseMessage, Telemetry
from robot.navigation.lane_view import LaneView
from robot.navigation.neighbours import STILL_MPS, Neighbours
from robot.safety.road_ahead import RoadAhead

BELIEVED_M = 0.05  # standard deviation of what a robot tells of its place
KNOWN_M = 0.125  # 95 % sure of it, as by a person's word: who is less sure tells nothing,
STANDS_KNOWN_M, STANDS_S = 0.25, 5.0  # unless it has stood for so long: nobody may wait for it then
Reports = Mapping[str, Callable[[], Optional[Telemetry]]]


class Company(Neighbours):
    """`Neighbours` as they tell themselves; all must be heard, or nobody knows what is on the road.

    ``reports``: by name, what gives another robot's newest one, or None, and never blocks.
    """

    def __init__(self, view: LaneView, robot: str, reports: Reports) -> None:
        super().__init__(view, robot, BELIEVED_M)
        self._reports, self._turns = reports, 0
        self._above: List[PoseMessage] = []
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
