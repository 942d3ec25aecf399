"""Robots without a localizer tell each other over the link where they believe to be."""

import math
from typing import Callable, Mapping, Optional, Sequence

import numpy as np

from robot.geometry import Pose
from robot.link.messages import PoseMessage, Telemetry
from robot.navigation.lane_view import LaneView
from robot.navigation.neighbours import Neighbours
from robot.safety.road_ahead import RoadAhead

BELIEVED_M = 0.05  # standard deviation of what a robot tells of its place
KNOWN_M = 0.125  # 95 % sure of it, as by a person's word: who is less sure tells nothing
Reports = Mapping[str, Callable[[], Optional[Telemetry]]]


class Company(Neighbours):
    """`Neighbours` as they tell themselves; all must be heard, or nobody knows what is on the road.

    ``reports``: by name, what gives another robot's newest one, or None, and never blocks.
    """

    def __init__(self, view: LaneView, robot: str, reports: Reports) -> None:
        super().__init__(view, robot, BELIEVED_M)
        self._reports, self._turns = reports, 0
        self._said_s = dict.fromkeys(reports, -math.inf)

    def hear(self, poses: Sequence[PoseMessage], now_s: float) -> None:
        """Nothing: by a localizer's poses everybody would be told of twice."""

    def ahead(self, now_s: float, pose: Pose, way_m: np.ndarray) -> RoadAhead:
        """As of `Neighbours`, by what has been said up to now."""
        self._turns += 1
        told = [PoseMessage(self._robot, *pose, 1.0, now_s, "own", self._turns, now_s)]
        for name, receive in self._reports.items():
            said = receive()
            known = said is not None and said.belief is not None and said.belief.long_m <= KNOWN_M
            if said is not None and said.pose is not None and known and said.robot == name:
                stamp = said.session, said.sequence, said.t_sent_s
                told.append(PoseMessage(name, *said.pose, 1.0, said.t_sent_s, *stamp))
        self._said_s.update(self._take(told, now_s))
        self._heard_s = min(self._said_s.values(), default=now_s)
        return super().ahead(now_s, pose, way_m)
