"""``KeepApart``: a way left before whatever is on the lane."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Tuple

from robot.safety.governors import Cap, Road

GAP_M = 0.04  # from the nose to a thing before which the robot stands
HEADWAY_S = 0.9  # in which it would be there: turn, delay and lag of the motors three times over
_SIGMAS = 2.0
_LEAST_MPS = 0.02  # slower than that is standing


@dataclass(frozen=True)
class KeepApart:
    """Never so fast that the robot could not stand before what is on its lane.

    It counts on nothing: what drives ahead may stop dead at any time. What comes nearer by itself
    takes the way that it will make in the meantime.
    """

    def after(self, road: Road) -> Tuple[KeepApart, Cap]:
        """See `Rule`."""
        ahead = road.ahead
        if ahead.free_m == math.inf:
            return self, Cap()
        if math.isnan(ahead.free_m):
            return self, Cap(0.0, "nothing tells where the others are")
        sure_m = ahead.free_m - _SIGMAS * ahead.free_sigma_m - GAP_M
        most_mps = sure_m / HEADWAY_S - max(0.0, ahead.coming_mps)
        if not most_mps >= _LEAST_MPS:  # nor a NaN
            most_mps = 0.0
        return self, Cap(most_mps, f"something is {100.0 * ahead.free_m:.0f} cm ahead")
