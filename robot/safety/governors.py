"""Rules of the road. Each gives a highest speed and why; the lowest holds, along the same curve.

A rule is pure: what it remembers is itself. Rules stand between the policy's choice and the limits
of the wheels; they slow a robot that drives by itself, and never make it go.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import NamedTuple, Optional, Protocol, Sequence, Tuple

from robot.errors import ConfigError
from robot.safety.road_ahead import AtJunction, RoadAhead

NOSE_M = 0.066  # of the robot, before its axle


class Road(NamedTuple):
    """What the rules look at in one turn."""

    now_s: float
    driven_m: float  # by the wheels' steps, since anywhere
    told_mps: float  # the faster wheel, in the turn before
    ahead: RoadAhead = RoadAhead()


class Cap(NamedTuple):
    """The most that the faster wheel may do [m/s], and why."""

    most_mps: float = math.inf
    reason: str = ""


class Rule(Protocol):
    """One rule of the road, with its memory."""

    def after(self, road: Road) -> Tuple[Rule, Cap]:
        """The rule as it goes on from this turn, and its cap."""


def govern(rules: Sequence[Rule], road: Road) -> Tuple[Tuple[Rule, ...], Cap]:
    """Ask all rules; the first of the lowest caps holds."""
    asked = [rule.after(road) for rule in rules]
    caps = (cap for _, cap in asked)
    return tuple(rule for rule, _ in asked), min(caps, key=lambda cap: cap.most_mps, default=Cap())


STAND_S = 1.2  # told to stand: with motors that lag by 0.2 s half a second at rest is left
_STOP_M = 0.05  # from the nose to the line: the middle of what is right
_AT_M = 0.01  # before that place it is reached
_STAY_M = 0.1  # who stands so near to a line stays, though the belief may move
_BEHIND_M = -0.04  # a line under the robot is behind it
_BRAKE_S = 0.5  # slower with what is left, so that a motor's lag does not carry it over the line
_CREEP_MPS = 0.04
_SAME_M = 0.12  # so near to each other two tellings mean one line
_SURE = 2  # tellings of a line before it counts
_KEPT = 5  # turns for which a line is remembered of which nothing is told
_PAST_M = 0.25  # behind a line where the robot stood: there none is meant


@dataclass(frozen=True)
class StopLines:
    """Stand with the nose 0 to 10 cm before each red line, for half a second at least, then go on.

    A line that was told twice is remembered by the wheels' steps when it is not told again.
    """

    at_m: float = math.nan  # of the line, where ``driven_m`` will be with the nose there
    told: int = 0
    since_s: Optional[float] = None  # the robot has stood at it
    free_m: float = -math.inf  # ``driven_m`` up to which no line counts

    def after(self, road: Road) -> Tuple[StopLines, Cap]:
        """See `Rule`."""
        if road.driven_m < self.free_m:
            return StopLines(free_m=self.free_m), Cap()
        rule = self._told(road)
        left_m = rule.at_m - road.driven_m
        if rule.told < _SURE or left_m < _BEHIND_M:
            return replace(rule, since_s=None), Cap()
        if left_m > (_STOP_M + _AT_M if rule.since_s is None else _STAY_M):
            most_mps = max(_CREEP_MPS, (left_m - _STOP_M) / _BRAKE_S)
            reason = f"a stop line is {100.0 * left_m:.0f} cm ahead"
            return replace(rule, since_s=None), Cap(most_mps, reason)
        if rule.since_s is None or road.told_mps > 0.0:
            rule = replace(rule, since_s=road.now_s)
        elif road.now_s - rule.since_s >= STAND_S:
            return StopLines(free_m=rule.at_m + _PAST_M), Cap()
        return rule, Cap(0.0, "it stands at a stop line")

    def _told(self, road: Road) -> StopLines:
        """With what is told of a line in this turn."""
        line_m = road.ahead.line_m
        if line_m is None:
            fewer = self.told if self.since_s is not None else max(0, self.told - 1)
            return replace(self, told=fewer)
        at_m = road.driven_m + line_m
        if self.told and abs(at_m - self.at_m) < _SAME_M:
            return replace(self, at_m=at_m, told=min(self.told + 1, _KEPT))
        if self.since_s is not None:
            return self
        return replace(self, at_m=at_m, told=1)


@dataclass(frozen=True)
class Lights:
    """Stand before the line while its light is red. Otherwise all look around as ever."""

    def after(self, road: Road) -> Tuple[Lights, Cap]:
        """See `Rule`."""
        left_m = road.ahead.line_m
        if not road.ahead.red_light or left_m is None or left_m < _BEHIND_M:
            return self, Cap()
        most_mps = (left_m - _STOP_M) / _BRAKE_S
        return self, Cap(most_mps if left_m > _STOP_M + _AT_M else 0.0, "the light is red")


GAP_M = 0.04  # from the nose to a thing before which the robot stands
HEADWAY_S = 0.9  # in which it would be there: turn, delay and lag of the motors three times over
_SIGMAS = 2.0
_CLEAR = 10  # turns: errors of poses last that long
_LEAST_MPS = 0.02  # slower than that is standing
_UNSURE_M = 0.08  # deviation of what has not been made out
_PATIENCE_S = 3.0  # after which who stands before that goes nearer to see,
_LOOK_M = 0.08  # to so far from its nose by the likeliest: nearer things sight has not learned


@dataclass(frozen=True)
class KeepApart:
    """Never so fast that the robot could not stand before what is on its lane.

    It counts on nothing: what drives ahead may stop dead at any time. What comes nearer by itself
    takes the way that it will make in the meantime. Who stands goes on only with two deviations to
    spare, or after a second of nothing, lest it go nearer whenever what it is told errs. What is
    beside the lane may look from afar as if it were on it, and nobody knows how far it is: who has
    stood before such a thing for a while creeps up to it.
    """

    stands: bool = False
    clear: int = 0  # turns in a row in which nothing was told, since it stood
    since_s: float = math.nan  # it has stood

    def after(self, road: Road) -> Tuple[KeepApart, Cap]:
        """See `Rule`."""
        ahead = road.ahead
        if ahead.free_m == math.inf:
            rule = replace(self, clear=self.clear + 1)
            if self.stands and ahead.free_sigma_m > 0.0 and rule.clear < _CLEAR:
                return rule, Cap(0.0, "what it stood before may be there yet")
            return KeepApart(), Cap()
        if math.isnan(ahead.free_m):
            return self, Cap(0.0, "nothing tells where the others are")
        reason = f"something is {100.0 * ahead.free_m:.0f} cm ahead"
        sure_mps = self._most(ahead, (1.0 + self.stands) * _SIGMAS * ahead.free_sigma_m + GAP_M)
        if sure_mps > 0.0:
            return KeepApart(), Cap(sure_mps, reason)
        since_s = self.since_s if self.stands else road.now_s
        waited = road.now_s >= since_s + _PATIENCE_S and ahead.free_sigma_m > _UNSURE_M
        creep_mps = min(_CREEP_MPS, self._most(ahead, _LOOK_M)) if waited else 0.0
        return KeepApart(True, 0, since_s), Cap(creep_mps, reason)

    @staticmethod
    def _most(ahead: RoadAhead, less_m: float) -> float:
        most_mps = (ahead.free_m - less_m) / HEADWAY_S - max(ahead.coming_mps, 0.0)
        return most_mps if most_mps >= _LEAST_MPS else 0.0  # nor a NaN


VIEWS_S = 0.4
TOGETHER_S = 0.3  # so near to each other two arrive together
LOOK_S = 0.9  # longer than `TOGETHER_S` and `VIEWS_S`: then it has seen who came together with it
QUIET_S = 4.0  # in which nobody goes, although all wait: then the least name goes, then the next
_STAND = Cap(0.0, "others go first at the junction")
_UNTOLD = Cap(0.0, "nothing tells who is at the junction")


@dataclass(frozen=True)
class FirstCome:
    """Who may enter a junction, among robots that see each other but do not talk.

    Each sees the others late, and takes other moments for those of their arrival, up to `VIEWS_S`
    apart. So a robot goes only if all others would let it, whatever of that they saw: it came
    clearly first, or at about the same time and from the right of them (of those who face each
    other the lower name is first). Before it enters it looks around for `LOOK_S`. Where nobody
    goes, robots go by their names. Who waits has its nose before the line.
    """

    quiet_s: Optional[float] = None  # since when it waits, nobody is inside, no lower name came
    look_s: Optional[float] = None  # since when it is its turn
    lower: int = 0  # others that wait, with lower names

    def after(self, road: Road) -> Tuple[FirstCome, Cap]:
        """See `Rule`."""
        at, line_m = road.ahead.junction, road.ahead.line_m
        if at is None and line_m is not None and 0.0 <= line_m <= _STOP_M + _AT_M:
            return FirstCome(), _UNTOLD  # poses that err do not tell yet that it stands there
        if at is None or at.own.inside:
            return FirstCome(), Cap()
        inside = [other.name for other in at.others if other.inside]
        if road.ahead.red_light or inside:
            return FirstCome(), _STAND if all(inside) else _UNTOLD
        # Of two the lower name never waits since later than the other, so their turns stay apart.
        lower = sum(other.name < at.own.name for other in at.others)
        quiet_s = road.now_s if self.quiet_s is None or lower > self.lower else self.quiet_s
        turn = all(_lets(other, at.own) for other in at.others)
        if not turn and road.now_s - quiet_s < QUIET_S * (1 + lower):
            return FirstCome(quiet_s, None, lower), _STAND
        look_s = road.now_s if self.look_s is None else self.look_s
        return FirstCome(quiet_s, look_s, lower), Cap() if road.now_s - look_s >= LOOK_S else _STAND


def _lets(other: AtJunction, own: AtJunction) -> bool:
    """Whether another surely lets this one go first."""
    earlier_s = other.arrived_s - own.arrived_s
    side = (own.arm - other.arm) % 4
    first = side == 1 or (side != 3 and own.name < other.name)
    return earlier_s > (-TOGETHER_S if first else TOGETHER_S + VIEWS_S)


@dataclass(frozen=True)
class Rules:
    """``rules`` of robot.yaml. ConfigError: right of way without the others, which it needs."""

    stop_lines: bool = False  # stand before each red line, then go on
    headway: bool = False  # stand before what is on the lane, and for want of who tells it
    right_of_way: bool = False  # at junctions: who came first, then who comes from the right

    def __post_init__(self) -> None:
        if self.right_of_way and not (self.stop_lines and self.headway):
            raise ConfigError(
                "rules.right_of_way: expected stop_lines and headway as well: it says who may go "
                "on from a line, and counts on poses of the others; add both, or leave it"
            )

    def chain(self) -> Tuple[Rule, ...]:
        """The rules that are asked for, as they begin."""
        every = (
            (self.headway, KeepApart()),
            (self.stop_lines, StopLines()),
            (self.right_of_way, FirstCome()),
        )
        return tuple(rule for asked, rule in every if asked)
