"""``LaneWatch``: what is in the way of a robot that keeps its lane, by its own pictures."""

from __future__ import annotations

from typing import Callable

from robot.geometry import Pose
from robot.navigation.road_watch import WaySeen
from robot.parts import Guidance
from robot.vision.sight import Glimpse


class LaneWatch:
    """A ``Navigator`` without map, place or path: it tells what lies ahead, by any ``odometry``."""

    def __init__(self, glimpse: Glimpse, odometry: Callable[[], Pose]) -> None:
        self._glimpse, self._way = glimpse, WaySeen()
        self._odometry, self._odometer, self._driven_m = odometry, odometry(), 0.0

    def look(self, now_s: float) -> Guidance:
        """What the newest picture shows, and how far the robot has driven since."""
        last, self._odometer = self._odometer, self._odometry()
        self._driven_m += last.arc_to(self._odometer)[0]
        glimpsed = self._glimpse.look()
        if glimpsed is not None:
            seen, taken_s = glimpsed
            self._way.see(seen, self._driven_m, taken_s)
        ahead = self._way.ahead(self._driven_m, now_s)
        return Guidance(ahead=ahead, driven_m=self._driven_m)
