"""However robots come to a crossing, no two whose ways cross are inside, and all get through."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass, field, replace
from typing import Iterator, List, Optional, Sequence, Tuple

import numpy as np
import pytest

from robot.safety.governors import Road
from robot.safety.right_of_way import RightOfWay, next_at
from robot.safety.road_ahead import AtJunction, Junction, Light, RoadAhead, Stage, Turn

TURN_S = 0.4  # between two decisions; so late robots see each other, too
THROUGH_S = {Turn.RIGHT: 1.6, Turn.STRAIGHT: 2.0, Turn.LEFT: 2.4}
WAYS = (Turn.RIGHT, Turn.STRAIGHT, Turn.LEFT)
# Quarters of a junction that a way passes through, by hand: from the south to right, on, left; ...
PASSED = {
    (0, Turn.RIGHT): {"se"},
    (0, Turn.STRAIGHT): {"se", "ne"},
    (0, Turn.LEFT): {"se", "ne", "nw"},
    (1, Turn.RIGHT): {"ne"},
    (1, Turn.STRAIGHT): {"ne", "nw"},
    (1, Turn.LEFT): {"ne", "nw", "sw"},
    (2, Turn.RIGHT): {"nw"},
    (2, Turn.STRAIGHT): {"nw", "sw"},
    (2, Turn.LEFT): {"nw", "sw", "se"},
    (3, Turn.RIGHT): {"sw"},
    (3, Turn.STRAIGHT): {"sw", "se"},
    (3, Turn.LEFT): {"sw", "se", "ne"},
}
Case = Tuple[Tuple[int, int, Turn], ...]  # arm, rank of arrival, way


@dataclass
class Robot:
    """One that comes to the crossing."""

    seen: AtJunction  # as it is now
    way: Turn
    rule: RightOfWay
    inside_s: float = 0.0
    goes_s: Optional[float] = None
    others: List[AtJunction] = field(default_factory=list)

    @property
    def done(self) -> bool:
        return self.inside_s > THROUGH_S[self.way]


def crossing(case: Case, names: str, told: bool, seed: int = 0, apart_s: float = 1.2) -> float:
    """Drive them all through, and check; when the last was out [s]."""
    rngs = [np.random.default_rng((seed, k)) for k in range(len(case))]
    robots = [
        Robot(
            AtJunction(arm, rank * apart_s, name, way if told else Turn.UNKNOWN),
            way,
            RightOfWay(rng),
        )
        for (arm, rank, way), name, rng in zip(case, names or [""] * 4, rngs)
    ]
    now_s, before = 0.0, {}  # type: ignore[var-annotated]
    while not all(robot.done for robot in robots):
        here = [r for r in robots if not r.done and r.seen.arrived_s <= now_s]
        inside = [PASSED[r.seen.arm, r.way] for r in here if r.seen.stage is Stage.INSIDE]
        assert len(set().union(*inside)) == sum(map(len, inside)), f"two inside: {case}"
        for robot in here:
            others = tuple(seen for key, seen in before.items() if key != id(robot))
            decide(robot, others, now_s)
        before = {id(robot): robot.seen for robot in here}
        now_s += TURN_S
        assert now_s < 90.0, f"somebody waits for ever: {case}"
    return now_s


def decide(robot: Robot, others: Tuple[AtJunction, ...], now_s: float) -> None:
    ahead = RoadAhead(junction=Junction(robot.seen, others))
    robot.rule, cap = robot.rule.after(Road(now_s, 0.0, 0.0, ahead))
    if robot.seen.stage is Stage.INSIDE:
        assert cap.most_mps == math.inf, "who is inside clears the junction"
        robot.inside_s += TURN_S
    elif cap.most_mps > 0.0:
        robot.seen = replace(robot.seen, stage=Stage.INSIDE)
    else:
        stage = Stage.CLAIMS if robot.rule.claims else Stage.WAITS
        robot.seen = replace(robot.seen, stage=stage)


def every_case(robots: Sequence[int] = (1, 2, 3, 4)) -> Iterator[Case]:
    """Who comes from which arms, in which order, ties included, and wants where."""
    for count in robots:
        for arms in itertools.combinations(range(4), count):
            for ranks in itertools.product(range(count), repeat=count):
                if sorted(set(ranks)) != list(range(len(set(ranks)))):
                    continue  # the same order again
                for ways in itertools.product(WAYS, repeat=count):
                    yield tuple(zip(arms, ranks, ways))


def test_there_are_so_many_cases() -> None:
    assert len(list(every_case())) == 4 * 3 + 6 * 3 * 9 + 4 * 13 * 27 + 75 * 81


def test_with_names_and_ways_told_every_crossing_resolves() -> None:
    names = itertools.cycle(itertools.permutations("abcd"))
    slowest = max(crossing(case, "".join(next(names)), told=True) for case in every_case())
    assert slowest < 20.0


@pytest.mark.slow
@pytest.mark.parametrize(("names", "told"), [("", True), ("", False), ("dacb", False)])
def test_without_a_link_every_crossing_resolves_too(names: str, told: bool) -> None:
    for seed, case in enumerate(every_case()):
        crossing(case, names, told, seed)


def test_four_without_a_link_at_the_same_moment_resolve_by_patience() -> None:
    case = tuple((arm, 0, Turn.LEFT) for arm in range(4))
    assert max(crossing(case, "", told=False, seed=seed) for seed in range(300)) < 60.0


def test_two_ways_conflict_where_they_share_a_quarter() -> None:
    for one, other in itertools.product(PASSED, repeat=2):
        a, b = AtJunction(one[0], 0.0, turn=one[1]), AtJunction(other[0], 0.0, turn=other[1])
        assert a.conflicts(b) == bool(PASSED[one] & PASSED[other])
        assert replace(a, turn=Turn.UNKNOWN).conflicts(b)


@pytest.mark.parametrize(
    ("others", "next_one"),
    [
        ((), True),
        (((1, 9.0, ""),), False),  # on the right
        (((3, 9.0, ""),), True),  # on the left
        (((1, 9.8, ""),), True),  # on the right, but later
        (((3, 8.0, ""),), False),  # on the left, but earlier
        (((2, 9.0, ""),), None),  # opposite, at the same moment
        (((2, 9.0, "b"),), False),  # opposite, with a lesser name
        (((2, 9.0, "d"),), True),
        (((1, 9.0, "d"), (2, 9.0, "e"), (3, 9.0, "f")), True),  # all have one on the right
    ],
)
def test_who_goes_first(
    others: Tuple[Tuple[int, float, str], ...], next_one: Optional[bool]
) -> None:
    own = AtJunction(0, 9.0, "c" if any(name for *_, name in others) else "")
    assert next_at(Junction(own, tuple(AtJunction(*each) for each in others))) is next_one


def test_a_robot_that_never_goes_is_not_waited_for() -> None:
    rule, broken = RightOfWay(np.random.default_rng(1)), AtJunction(1, 0.0, "a")
    own = AtJunction(0, 5.0, "b")
    for k in range(400):
        ahead = RoadAhead(junction=Junction(own, (broken,)))
        rule, cap = rule.after(Road(5.0 + 0.1 * k, 0.0, 0.0, ahead))
        if cap.most_mps > 0.0:
            break
    assert 4.0 < 0.1 * k < 9.0


def test_a_red_light_makes_nobody_claim_and_a_green_one_goes_before_who_waits_aside() -> None:
    aside = AtJunction(1, 0.0, "a")
    at = Junction(AtJunction(0, 5.0, "b"), (aside,))
    rule = RightOfWay(np.random.default_rng(1))
    for light, claims in ((Light.RED, False), (Light.NONE, False), (Light.GREEN, True)):
        after, cap = rule.after(Road(6.0, 0.0, 0.0, RoadAhead(light=light, junction=at)))
        assert (after.claims, cap.most_mps) == (claims, 0.0)
