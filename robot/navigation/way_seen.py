"""What sight tells of the way ahead, picture by picture, for the rules of the road."""

from __future__ import annotations

import math

from robot.safety.road_ahead import RoadAhead
from robot.vision.sight import Seen

THING = 0.5  # probability above which something is in the way
CLEAR = 3  # pictures in a row without it, after which it is gone
FRESH_S = 0.5  # older pictures tell nothing of the road


def free_way_seen(seen: Seen) -> RoadAhead:
    """The free way in the first of some pictures."""
    if not seen.thing[0] > THING:
        return RoadAhead()
    return RoadAhead(float(seen.figures[0, 4]), float(seen.deviations[0, 4]))


class WaySeen:
    """What is in the way counts from the first picture that shows it, and is remembered by the
    wheels' steps until some in a row show nothing: to stand for nothing is no harm."""

    def __init__(self) -> None:
        self._seen, self._at_m, self._clear, self._at_s = RoadAhead(), 0.0, 0, -math.inf

    def see(self, seen: Seen, driven_m: float, now_s: float) -> None:
        """A new picture, after so much driven."""
        way = free_way_seen(seen)
        self._at_s = now_s
        self._clear = self._clear + 1 if way.free_m == math.inf else 0
        if self._clear in (0, CLEAR):
            self._seen, self._at_m = way, driven_m

    def ahead(self, driven_m: float, now_s: float) -> RoadAhead:
        """The free way now; NaN, before which a robot stands, where no fresh picture tells."""
        gone_m = driven_m - self._at_m if now_s - self._at_s <= FRESH_S else math.nan
        return RoadAhead(self._seen.free_m - gone_m, self._seen.free_sigma_m)
