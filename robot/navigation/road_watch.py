"""What lies before the robot, for the rules of the road: on a map, or in its lane by sight."""

import math
from dataclasses import replace
from typing import Callable, Optional, Tuple

import numpy as np

from robot.geometry import Pose
from robot.navigation.lane_view import LaneView
from robot.navigation.neighbours import Neighbours
from robot.navigation.sight_fix import LINE
from robot.parts import Guidance
from robot.safety.governors import NOSE_M
from robot.safety.road_ahead import AtJunction, Junction, RoadAhead
from robot.vision.sight import Glimpse, Seen

MAP_LINES_M = 0.12  # 95 % sure of the place: else red lines are those that are seen
_NEAR_M = 0.3  # before a line, or a little over it
_ANYBODY = Junction(AtJunction(0, math.inf, ""), (AtJunction(0, 0.0, "", inside=True),))
THING, STILL = 0.8, 0.5  # probability above which something is in the way, and still is
CLEAR = 3  # pictures in a row without it, after which it is gone
FRESH_S = 0.5  # older pictures tell nothing of the road


class WaySeen:
    """What is in the way counts from the first picture that is sure of it, and is remembered by the
    wheels' steps until some in a row show rather nothing: to stand for nothing is no harm."""

    def __init__(self) -> None:
        self._seen, self._at_m, self._clear, self._at_s = RoadAhead(), 0.0, 0, -math.inf

    def see(self, seen: Seen, driven_m: float, now_s: float) -> None:
        """A new picture, after so much driven; without a number the way is not free."""
        way = RoadAhead()
        if not seen.thing[0] <= (THING if self._seen.free_m == math.inf else STILL):
            way = RoadAhead(float(seen.figures[0, 4]), float(seen.deviations[0, 4]))
        self._at_s = now_s
        self._clear = self._clear + 1 if way.free_m == math.inf else 0
        if self._clear in (0, CLEAR):
            self._seen, self._at_m = way, driven_m

    def ahead(self, driven_m: float, now_s: float) -> RoadAhead:
        """The free way now; NaN, before which a robot stands, where no fresh picture tells."""
        gone_m = driven_m - self._at_m if now_s - self._at_s <= FRESH_S else math.nan
        return RoadAhead(self._seen.free_m - gone_m, self._seen.free_sigma_m)


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
        return Guidance(ahead=self._way.ahead(self._driven_m, now_s), driven_m=self._driven_m)


class RoadWatch:
    """Red lines by the map or by sight; whoever is on the road by overhead poses or by sight.

    ``others`` hears of them, ``way`` sees them; either will do, and of both the nearer counts.
    Without both the road is empty.
    """

    def __init__(
        self, view: LaneView, others: Optional[Neighbours] = None, way: Optional[WaySeen] = None
    ) -> None:
        self.view, self.others, self._way = view, others, way
        self._line_seen_m = math.nan  # by the wheels' steps, with the axle there

    def saw(self, seen: Seen, driven_m: float, now_s: float) -> None:
        """What sight sees in a new picture, after so much driven by the wheels' steps."""
        lined = seen.line[0] > LINE and seen.in_lane[0]
        self._line_seen_m = driven_m + float(seen.figures[0, 3]) if lined else math.nan
        if self._way is not None:
            self._way.see(seen, driven_m, now_s)

    def look(
        self,
        now_s: float,
        driven_m: float,
        place: Optional[Tuple[Pose, float]] = None,
        way_m: Optional[np.ndarray] = None,
    ) -> RoadAhead:
        """What lies before a robot that has driven so far by its wheels' steps.

        It believes to be at a ``place``, within so much [m] by 95 %, on its way (61, 2) of
        `AHEAD_M`; without these nobody is known to be or not to be ahead but by sight.
        """
        ahead_m = self._line_seen_m - driven_m
        if place is not None and place[1] <= MAP_LINES_M:
            ahead_m = self.view.line_ahead_m(place[0])
        line_m = ahead_m - NOSE_M if math.isfinite(ahead_m) else None
        told = RoadAhead()
        if self.others is not None:
            told = RoadAhead(free_m=math.nan)
            if place is not None and way_m is not None:
                told = self.others.ahead(now_s, place[0], way_m)
        if math.isnan(told.free_m) and line_m is not None and line_m < _NEAR_M:
            told = replace(told, junction=_ANYBODY)  # sight does not tell who comes from the sides
        if self._way is not None:
            seen = self._way.ahead(driven_m, now_s)
            if math.isnan(told.free_m) or seen.free_m < told.free_m:
                own = seen.free_m, seen.free_sigma_m
                told = replace(told, free_m=own[0], free_sigma_m=own[1], coming_mps=0.0)
        return replace(told, line_m=line_m)
