"""``RoadWatch``: what lies before the robot, for the rules of the road."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Optional

import numpy as np

from robot.geometry import Pose
from robot.navigation.lane_view import LaneView
from robot.navigation.neighbours import Neighbours
from robot.safety.governors import NOSE_M
from robot.safety.road_ahead import RoadAhead

MAP_LINES_M = 0.12  # 95 % sure of the place: else red lines are those that are seen


class RoadWatch:
    """Red lines by the map or by sight; whoever is on the road by overhead poses.

    ``others``: hears of them; without, the road is empty.
    """

    def __init__(self, view: LaneView, others: Optional[Neighbours] = None) -> None:
        self.view, self.others = view, others
        self._line_seen_m = math.nan  # by the wheels' steps, with the axle there

    def saw_line(self, at_m: float) -> None:
        """Where sight saw the next red line, by the wheels' steps; NaN where it saw none."""
        self._line_seen_m = at_m

    def look(
        self, now_s: float, pose: Pose, within_m: float, driven_m: float, way_m: np.ndarray
    ) -> RoadAhead:
        """What lies before a robot that has driven so far by its wheels' steps.

        It believes to be at ``pose``, within so much by 95 %, on its way (61, 2) of `AHEAD_M`.
        """
        ahead_m = self._line_seen_m - driven_m
        if within_m <= MAP_LINES_M:
            ahead_m = self.view.line_ahead_m(pose)
        line_m = ahead_m - NOSE_M if math.isfinite(ahead_m) else None
        if self.others is None:
            return RoadAhead(line_m=line_m)
        return replace(self.others.ahead(now_s, pose, way_m), line_m=line_m)
