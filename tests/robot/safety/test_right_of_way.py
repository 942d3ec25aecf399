"""However robots come to a crossing, whatever each sees: one is inside, and all get through."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass, field, replace
from typing import Dict, Iterator, List, Optional, Sequence, Tuple

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from robot.safety.governors import Cap, FirstCome, Road
from robot.safety.road_ahead import AtJunction, Junction, RoadAhead
from tests.thorough import THOROUGH, count

TURN_S, LATE_TURNS = 0.1, 4  # so late robots see each other
THROUGH_S, ENTERS_S = 2.0, 0.4  # after the rule lets it go it is seen inside
ERROR_S = 0.15  # of when each takes another to have arrived
Case = Tuple[Tuple[int, float], ...]  # arm, time of arrival [s]


@dataclass
class Robot:
    """One that comes to the crossing, and what it takes for the others' times of arrival."""

    at: AtJunction
    errors_s: Dict[str, float]
    rule: FirstCome = field(default_factory=FirstCome)
    goes_s: float = math.inf

    @property
    def here(self) -> Tuple[int, float, str]:
        """Its arm, time of arrival and name."""
        return self.at.arm, self.at.arrived_s, self.at.name

    def inside(self, now_s: float) -> bool:
        return self.goes_s + ENTERS_S <= now_s < self.goes_s + THROUGH_S

    def turn(self, now_s: float, others: Sequence[AtJunction]) -> None:
        off_s = self.errors_s
        seen = [AtJunction(o.arm, o.arrived_s + off_s[o.name], o.name, o.inside) for o in others]
        ahead = RoadAhead(junction=Junction(self.at, tuple(seen)))
        self.rule, cap = self.rule.after(Road(now_s, 0.0, 0.0, ahead))
        if cap.most_mps > 0.0:
            self.goes_s = now_s


def crossing(case: Case, names: Sequence[str], error_s: float, seed: int) -> float:
    """Drive them all through, and check; when the last was out [s]."""
    rng = np.random.default_rng(seed)
    robots = []
    for (arm, at_s), name in zip(case, names):
        errors_s = rng.uniform(-error_s, error_s, len(names)).tolist()
        robots.append(Robot(AtJunction(arm, at_s, name), dict(zip(names, errors_s))))
    shown: List[List[AtJunction]] = []
    for k in range(600):
        now_s = TURN_S * k
        here = [r for r in robots if r.at.arrived_s <= now_s < r.goes_s + THROUGH_S]
        shown.append([AtJunction(*r.here, r.inside(now_s)) for r in here])
        assert sum(r.inside(now_s) for r in robots) <= 1, f"two inside: {case}, {names}"
        for robot in here:
            if robot.goes_s == math.inf:
                late = shown[max(k - LATE_TURNS, 0)]
                robot.turn(now_s, [o for o in late if o.name != robot.at.name])
        if all(robot.goes_s + THROUGH_S <= now_s for robot in robots):
            return now_s
    raise AssertionError(f"somebody waits for ever: {case}, {names}")


def every_case() -> Iterator[Tuple[Case, Tuple[str, ...]]]:
    """Who comes from which arms, how long after each other, by which names."""
    for many in (1, 2, 3, 4):
        for arms in itertools.combinations(range(4), many):
            for after_s in itertools.product((0.0, 0.3, 0.6, 1.2), repeat=many):
                if min(after_s) == 0.0:
                    for names in itertools.permutations("abcd"[:many]):
                        yield tuple(zip(arms, after_s)), names


@pytest.mark.slow
@pytest.mark.parametrize("error_s", [0.0, ERROR_S])
def test_every_crossing_resolves_whatever_each_sees(error_s: float) -> None:
    some = list(every_case())[::25]
    slowest = max(crossing(*case, error_s, seed) for seed, case in enumerate(some))
    assert slowest < 4 * (4.0 + 1.2 + 2.0 + 1.0)


@pytest.mark.slow
def test_every_crossing_of_all_resolves() -> None:
    """But for turns of the whole crossing: always a comes from arm 0, unless all are asked for."""
    for seed, (case, names) in enumerate(every_case()):
        if THOROUGH or (case[0][0], names[0]) == (0, "a"):
            crossing(case, names, ERROR_S, seed)


@pytest.mark.slow
def test_of_those_who_come_seconds_after_each_other_one_is_inside() -> None:
    """By their names they go after so many seconds; whose turn that is changes with who waits."""
    for seed in range(count(1500, 60_000)):
        rng = np.random.default_rng(seed)
        arms = rng.permutation(4)[: rng.integers(3, 5)].tolist()
        after_s = [0.0, *rng.uniform(0.0, 9.0, len(arms) - 1).round(1).tolist()]
        names = rng.permutation(list("abcd"))[: len(arms)].tolist()
        crossing(tuple(zip(arms, after_s)), names, float(rng.choice((0.0, ERROR_S))), seed)


@pytest.mark.parametrize(("arm", "name", "most_s"), [
    *[(3, "c", -0.3), (2, "c", -0.3), (2, "a", 0.7), (1, "c", 0.7)],
])  # fmt: skip
def test_who_came_so_much_later_lets_one_go_first(arm: int, name: str, most_s: float) -> None:
    """b, from arm 0: before who is on the left or faces it with a higher name, by less."""
    own = AtJunction(0, 9.0, "b")
    for later_s in (most_s - 0.01, most_s + 0.01):
        rule, cap = FirstCome(), Cap()
        road = RoadAhead(junction=Junction(own, (AtJunction(arm, 9.0 + later_s, name),)))
        for k in range(11):
            rule, cap = rule.after(Road(10.0 + 0.1 * k, 0.0, 0.0, road))
        assert (cap.most_mps == math.inf) is (later_s > most_s)


def test_two_turns_do_not_fall_together_because_a_third_comes() -> None:
    crossing(((0, 0.4), (1, 3.9), (3, 0.0)), "cad", 0.0, 0)


@given(st.integers(0, 3), st.lists(st.tuples(st.integers(0, 3), st.floats(-2.0, 2.0)), max_size=3))
def test_a_crossing_that_is_turned_is_the_same(arm: int, others: List[Tuple[int, float]]) -> None:
    def turned(by: int) -> Tuple[FirstCome, Cap]:
        at = [AtJunction((a + by) % 4, 9.0 + s, n) for (a, s), n in zip(others, "abd")]
        met = Junction(AtJunction((arm + by) % 4, 9.0, "c"), tuple(at))
        return FirstCome().after(Road(9.0, 0.0, 0.0, RoadAhead(junction=met)))

    assert turned(0) == turned(1) == turned(2) == turned(3)


@pytest.mark.parametrize(
    ("others", "looks"),
    [
        ((), True),
        (((1, 9.0, "d"),), False),  # on the right, at the same time
        (((3, 9.0, "b"),), True),  # on the left
        (((1, 9.8, "b"),), True),  # on the right, but clearly later
        (((1, 9.5, "b"),), False),  # later, but perhaps not for the other
        (((3, 8.0, "d"),), False),  # on the left, but earlier
        (((2, 9.1, "b"),), False),  # opposite, with a lesser name
        (((2, 9.1, "d"),), True),
    ],
)
def test_who_goes_first(others: Tuple[Tuple[int, float, str], ...], looks: bool) -> None:
    at = Junction(AtJunction(0, 9.0, "c"), tuple(AtJunction(*each) for each in others))
    rule, cap = FirstCome().after(Road(9.0, 0.0, 0.0, RoadAhead(junction=at)))
    assert cap.most_mps == 0.0
    assert (rule.look_s is not None) is looks


@pytest.mark.parametrize(("after_s", "goes"), [(0.89, False), (0.91, True)])
def test_it_looks_around_for_so_long_before_it_enters(after_s: float, goes: bool) -> None:
    ahead = RoadAhead(junction=Junction(AtJunction(0, 5.0, "b")))
    rule, _ = FirstCome().after(Road(5.0, 0.0, 0.0, ahead))
    _, cap = rule.after(Road(5.0 + after_s, 0.0, 0.0, ahead))
    assert (cap.most_mps > 0.0) is goes


@pytest.mark.parametrize(
    ("line_m", "goes"), [(0.061, True), (0.059, False), (0.0, False), (-0.001, True), (None, True)]
)
def test_who_stands_at_a_line_goes_only_once_it_is_told_who_else_does(
    line_m: Optional[float], goes: bool
) -> None:
    """Two robots met inside: one had stood at its line, which poses that err did not tell."""
    _, cap = FirstCome().after(Road(9.0, 0.0, 0.0, RoadAhead(line_m=line_m)))
    assert (cap.most_mps > 0.0) is goes


def test_one_that_never_goes_holds_nobody_up_for_ever_and_one_inside_does() -> None:
    broken = AtJunction(1, 0.0, "a")
    at = Junction(AtJunction(0, 5.0, "b"), (broken,))
    for inside, goes in ((False, True), (True, False)):
        rule, most_mps = FirstCome(), 0.0
        met = replace(at, others=(replace(broken, inside=inside),))
        for k in range(120):
            ahead = RoadAhead(junction=met)
            rule, cap = rule.after(Road(5.0 + TURN_S * k, 0.0, 0.0, ahead))
            most_mps = cap.most_mps
        assert (most_mps > 0.0) is goes


@pytest.mark.parametrize("red", [True, False])
def test_at_a_red_light_who_came_first_waits(red: bool) -> None:
    at = Junction(AtJunction(0, 5.0, "b"), (AtJunction(1, 9.0, "a"), AtJunction(3, 9.0, "c")))
    rule, most_mps = FirstCome(), 0.0
    for k in range(30):
        ahead = RoadAhead(red_light=red, junction=at)
        rule, cap = rule.after(Road(5.0 + TURN_S * k, 0.0, 0.0, ahead))
        most_mps = cap.most_mps
    assert (most_mps > 0.0) is not red


def looks_after_s(turns: Sequence[Tuple[AtJunction, ...]]) -> float:
    """When robot b, that came from arm 0 at 5 s, begins to look around, with others by turns."""
    rule = FirstCome()
    for k, others in enumerate(turns):
        ahead = RoadAhead(junction=Junction(AtJunction(0, 5.0, "b"), others))
        rule, _ = rule.after(Road(5.0 + TURN_S * k, 0.0, 0.0, ahead))
        if rule.look_s is not None:
            return rule.look_s - 5.0
    return math.inf


@pytest.mark.parametrize(("names", "after_s"), [("", 0), ("c", 4), ("a", 8), ("ac", 8), ("aA", 12)])
def test_where_nobody_goes_the_least_name_goes_after_four_seconds_then_the_next(
    names: str, after_s: float
) -> None:
    others = tuple(AtJunction(1, 0.0, name) for name in names)
    assert looks_after_s([others] * 130) == pytest.approx(after_s)


def test_only_a_lower_name_that_comes_makes_it_wait_anew() -> None:
    low, high = AtJunction(1, 0.0, "a"), AtJunction(1, 0.0, "c")
    assert looks_after_s([(low, high)] * 30 + [(high,)] * 60) == pytest.approx(4.0), "it goes"
    assert looks_after_s([(high,)] * 30 + [(low, high)] * 99) == pytest.approx(11.0), "it comes"


def test_whose_turn_is_interrupted_looks_around_anew() -> None:
    rule, goes = FirstCome(), []
    for k in range(25):
        others = (AtJunction(1, 0.0, "a"),) * (5 <= k < 10)
        ahead = RoadAhead(junction=Junction(AtJunction(0, 5.0, "b"), others))
        rule, cap = rule.after(Road(5.0 + TURN_S * k, 0.0, 0.0, ahead))
        goes.append(cap.most_mps > 0.0)
    assert goes.index(True) in (19, 20), "0.9 s after the other went"


@pytest.mark.parametrize(("name", "says"), [("a", "others go first"), ("", "nothing tells who")])
def test_it_says_whether_it_knows_who_is_inside(name: str, says: str) -> None:
    at = Junction(AtJunction(0, 5.0, "b"), (AtJunction(1, 0.0, name, inside=True),))
    _, cap = FirstCome().after(Road(5.0, 0.0, 0.0, RoadAhead(junction=at)))
    assert cap.reason.startswith(says)


def test_who_is_inside_drives_out_whoever_else_is_there() -> None:
    """Two that stood in the middle and waited for each other would stand there for ever."""
    own, other = (AtJunction(arm, 0.0, name, inside=True) for arm, name in ((0, "a"), (1, "b")))
    for others in ((other,), (replace(other, inside=False),), ()):
        road = Road(9.0, 0.0, 0.2, RoadAhead(junction=Junction(own, others)))
        assert FirstCome().after(road) == (FirstCome(), Cap())


def test_of_two_of_one_name_who_face_each_other_neither_lets_itself_go_first() -> None:
    own, other = AtJunction(0, 0.0, "duck"), AtJunction(2, 0.0, "duck")
    rule: FirstCome = FirstCome()
    for turn in range(20):
        road = Road(0.1 * turn, 0.0, 0.0, RoadAhead(junction=Junction(own, (other,))))
        after, cap = rule.after(road)
        assert cap.most_mps == 0.0
        assert isinstance(after, FirstCome)
        rule = after
