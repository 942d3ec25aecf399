"""Who may enter a junction. Never two whose ways cross; nobody waits for ever.

``RightOfWay`` is of robots that can talk. Who came first goes first; of those who came together,
who has nobody on the right. Four who came together all have somebody on the right: then the least
name goes, and without names whose random patience ends first. Before it enters, a robot claims the
junction for `CLAIM_S` and stands: whoever claims at the same time sees it, and both fall back on
patience. So two never enter together, though each sees the other only late.

``FirstCome`` is of robots that see each other but cannot talk. Each sees the others late, and takes
other moments for those of their arrival, up to `VIEWS_S` apart. So a robot goes only if all others
would let it, whatever of that they saw: it came clearly first, or at about the same time and from
the right of them (of those who face each other the lesser name is first). Before it enters it looks
around for `LOOK_S`. Where nobody goes, robots go by their names.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Optional, Sequence, Tuple

import numpy as np

from robot.safety.governors import Cap, Road
from robot.safety.road_ahead import AtJunction, Junction, Light, Stage

CLAIM_S = 0.8  # longer than any other robot needs to see a claim
PATIENCE_S = 2.0  # at most, at first; longer after each clash
QUIET_S = 4.0  # in which nobody goes, although all wait: then patience decides, too, or names
_MOST_CLASHES = 3  # that make patience longer
VIEWS_S = 0.4
TOGETHER_S = 0.3  # so near to each other two arrive together
LOOK_S = 1.2  # longer than it takes to see who came together with it
_STAND = Cap(0.0, "others go first at the junction")


@dataclass(frozen=True)
class RightOfWay:
    """See `robot.safety.governors.Rule`; a robot waits with its nose before the line."""

    rng: np.random.Generator
    claimed_s: Optional[float] = None  # since when it claims
    until_s: Optional[float] = None  # it is patient
    quiet_s: Optional[float] = None  # since when it waits and nobody else claims or is inside
    clashes: int = 0

    @property
    def claims(self) -> bool:
        """Whether the robot tells that it goes next."""
        return self.claimed_s is not None

    def after(self, road: Road) -> Tuple[RightOfWay, Cap]:
        """See `robot.safety.governors.Rule`."""
        at = road.ahead.junction
        if at is None or at.own.stage is Stage.INSIDE:
            return RightOfWay(self.rng), Cap()
        going = [other for other in at.others if other.stage is not Stage.WAITS]
        busy = [other.stage for other in going if other.conflicts(at.own)]
        if self.claimed_s is not None:
            return self._claiming(road.now_s, self.claimed_s, busy)
        if road.ahead.light is Light.RED:
            return RightOfWay(self.rng), _STAND
        if busy:
            return replace(self, quiet_s=None, until_s=None), _STAND
        quiet_s = road.now_s if going or self.quiet_s is None else self.quiet_s
        if road.ahead.light is Light.GREEN:  # who waits on either side has a red one
            facing = (other for other in at.others if (other.arm - at.own.arm) % 2 == 0)
            at = Junction(at.own, tuple(facing))
        return replace(self, quiet_s=quiet_s)._waiting(road.now_s, quiet_s, at), _STAND

    def _claiming(
        self, now_s: float, claimed_s: float, busy: Sequence[Stage]
    ) -> Tuple[RightOfWay, Cap]:
        goes = now_s - claimed_s >= CLAIM_S
        if Stage.INSIDE in busy or (busy and not goes):
            return self._clashed(), _STAND
        return self, Cap() if goes else _STAND

    def _waiting(self, now_s: float, quiet_s: float, at: Junction) -> RightOfWay:
        turn = next_at(at)
        claiming = replace(self, claimed_s=now_s)
        if turn is True and self.clashes < 2:
            return claiming
        if turn is False and now_s - quiet_s < QUIET_S:
            return self
        if self.until_s is None:
            return replace(self, until_s=now_s + self._patience_s())
        return claiming if now_s >= self.until_s else self

    def _clashed(self) -> RightOfWay:
        return RightOfWay(self.rng, clashes=min(self.clashes + 1, _MOST_CLASHES))

    def _patience_s(self) -> float:
        return float(self.rng.uniform(0.0, PATIENCE_S * (1 + self.clashes)))


def next_at(junction: Junction) -> Optional[bool]:
    """Whether the robot is the next among those who wait; None where chance must decide.

    Those who go before it count only where their ways cross its own.
    """
    own = junction.own
    left = (own, *(other for other in junction.others if other.stage is Stage.WAITS))
    while True:
        first = _first(left)
        crossing = [each for each in first if each is not own and each.conflicts(own)]
        if own in first:
            return None if crossing else True
        if crossing:
            return False
        left = tuple(each for each in left if each not in first)


def _first(waiting: Tuple[AtJunction, ...]) -> Tuple[AtJunction, ...]:
    """Who may go first of those who wait: one, unless names are missing."""
    first = tuple(a for a in waiting if not any(_before(b, a) for b in waiting)) or waiting
    if all(each.name for each in first):
        return (min(first, key=lambda each: each.name),)
    return first


def _before(one: AtJunction, other: AtJunction) -> bool:
    if one.arrived_s == other.arrived_s:
        return one.arm == (other.arm + 1) % 4
    return one.arrived_s < other.arrived_s


@dataclass(frozen=True)
class FirstCome:
    """See `robot.safety.governors.Rule`; a robot waits with its nose before the line."""

    quiet_s: Optional[float] = None  # since when it waits and nobody is inside
    look_s: Optional[float] = None  # since when it is its turn

    def after(self, road: Road) -> Tuple[FirstCome, Cap]:
        """See `robot.safety.governors.Rule`."""
        at = road.ahead.junction
        if at is None or at.own.stage is Stage.INSIDE:
            return FirstCome(), Cap()
        if any(other.stage is Stage.INSIDE for other in at.others):
            return FirstCome(), _STAND
        quiet_s = road.now_s if self.quiet_s is None else self.quiet_s
        lesser = sum(other.name < at.own.name for other in at.others)
        turn = all(_lets(other, at.own) for other in at.others)
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
