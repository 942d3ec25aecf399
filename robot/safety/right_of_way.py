"""``FirstCome``: who may enter a junction, among robots that see each other but do not talk.

Each sees the others late, and takes other moments for those of their arrival, up to `VIEWS_S`
apart. So a robot goes only if all others would let it, whatever of that they saw: it came clearly
first, or at about the same time and from the right of them (of those who face each other the
lesser name is first). Before it enters it looks around for `LOOK_S`. Where nobody goes, robots go
by their names.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Optional, Tuple

from robot.safety.governors import Cap, Road
from robot.safety.road_ahead import AtJunction, Light

VIEWS_S = 0.4
TOGETHER_S = 0.3  # so near to each other two arrive together
LOOK_S = 1.2  # longer than it takes to see who came together with it
QUIET_S = 4.0  # in which nobody goes, although all wait: then the least name goes, then the next
_STAND = Cap(0.0, "others go first at the junction")


@dataclass(frozen=True)
class FirstCome:
    """See `robot.safety.governors.Rule`; a robot waits with its nose before the line."""

    quiet_s: Optional[float] = None  # since when it waits and nobody is inside
    look_s: Optional[float] = None  # since when it is its turn

    def after(self, road: Road) -> Tuple[FirstCome, Cap]:
        """See `robot.safety.governors.Rule`."""
        at = road.ahead.junction
        if at is None or at.own.inside:
            return FirstCome(), Cap()
        if road.ahead.light is Light.RED or any(other.inside for other in at.others):
            return FirstCome(), _STAND
        others = at.others
        if road.ahead.light is Light.GREEN:  # who waits on either side has a red one
            others = tuple(o for o in others if (o.arm - at.own.arm) % 2 == 0)
        quiet_s = road.now_s if self.quiet_s is None else self.quiet_s
        lesser = sum(other.name < at.own.name for other in others)
        turn = all(_lets(other, at.own) for other in others)
        if not turn and road.now_s - quiet_s < QUIET_S * (1 + lesser):
            return FirstCome(quiet_s), _STAND
        look_s = road.now_s if self.look_s is None else self.look_s
        goes = road.now_s - look_s >= LOOK_S
        return FirstCome(quiet_s, look_s), Cap() if goes else _STAND


def _lets(other: AtJunction, own: AtJunction) -> bool:
    """Whether another surely lets this one go first."""
    earlier_s = other.arrived_s - own.arrived_s
    side = (own.arm - other.arm) % 4
    first = side == 1 or (side != 3 and own.name < other.name)
    return earlier_s > (-TOGETHER_S if first else TOGETHER_S + VIEWS_S)
