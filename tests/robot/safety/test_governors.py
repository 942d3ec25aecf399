"""Rules of the road: they only slow, along the same curve, and stand at red lines as they must."""

from __future__ import annotations

import math
import random
from functools import partial
from typing import Callable, List, NamedTuple, Optional, Tuple

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from robot.errors import ConfigError, ContractError
from robot.geometry import WheelSpeeds
from robot.safety.governors import (
    NOSE_M,
    Cap,
    FirstCome,
    KeepApart,
    Lights,
    Road,
    Rules,
    StopLines,
    govern,
)
from robot.safety.road_ahead import RoadAhead
from robot.safety.wheel_limits import Drive

FREE = math.inf
FULL_MPS = 0.3
line = partial(RoadAhead, math.inf, 0.0, 0.0)  # nothing but a line so far ahead [m]
Telling = Callable[[float, float], Optional[float]]


class Fixed(NamedTuple):
    """A rule that always says the same."""

    cap: Cap

    def after(self, road: Road) -> "tuple[Fixed, Cap]":
        return self, self.cap


class Counting(NamedTuple):
    """A rule that remembers how often it was asked."""

    asked: int = 0

    def after(self, road: Road) -> "tuple[Counting, Cap]":
        return Counting(self.asked + 1), Cap()


CAPS = st.builds(Cap, st.floats(0.0, 1.0) | st.just(FREE), st.text(max_size=3))
SPEEDS = st.builds(WheelSpeeds, st.floats(-0.3, 0.3), st.floats(-0.3, 0.3))


@given(st.lists(CAPS, max_size=4))
def test_the_lowest_cap_holds_and_without_rules_any_speed_is_free(caps: List[Cap]) -> None:
    _, cap = govern([Fixed(each) for each in caps], Road(0.0, 0.0, FULL_MPS))
    assert cap.most_mps == min([FREE, *(each.most_mps for each in caps)])
    assert not caps or cap in caps


@given(SPEEDS, CAPS)
def test_a_cap_slows_both_wheels_alike_and_never_speeds_up(wanted: WheelSpeeds, cap: Cap) -> None:
    told = Drive(wanted, wanted, 0.1, cap).limited(0.5)
    fastest = max(map(abs, wanted))
    if cap.most_mps >= fastest:
        assert told == wanted
    # The rate of a wheel may hold it back, but never push it beyond what was wanted.
    assert all(abs(t) <= abs(w) + 1e-9 and t * w >= 0.0 for t, w in zip(told, wanted))
    settled = told
    for _ in range(5):
        settled = Drive(wanted, settled, 0.1, cap).limited(0.5)
    assert max(map(abs, settled)) <= cap.most_mps + 1e-9
    assert settled.left_mps * wanted.right_mps == pytest.approx(
        settled.right_mps * wanted.left_mps, abs=1e-9
    )


class Stand(NamedTuple):
    """A place where the robot stood: nose [m], for how long [s]."""

    nose_m: float
    for_s: float


def drive(
    tell: Telling, lag_s: float = 0.1, delay_turns: int = 0, until_m: float = 2.0
) -> List[Stand]:
    """Drive along a line at full speed under the rule, with a motor's lag; where it stood."""
    rule, nose_m, speed, stands = StopLines(), 0.0, FULL_MPS, []
    sent, since, k = [FULL_MPS] * (delay_turns + 1), None, 0
    while nose_m < until_m:
        k += 1
        assert k < 600, "it must go on"
        road = Road(0.1 * k, nose_m, sent[-1], line(tell(nose_m, 0.1 * k)))
        rule, cap = rule.after(road)
        sent.append(min(FULL_MPS, cap.most_mps))
        for _ in range(10):
            speed += (sent[-1 - delay_turns] - speed) * min(1.0, 0.01 / max(lag_s, 0.01))
            nose_m += 0.01 * speed
        if speed > 0.005:
            if since is not None:
                stands.append(Stand(nose_m, 0.1 * k - since))
            since = None
        elif since is None:
            since = 0.1 * k
    return stands


def at(*lines_m: float, reach_m: float = 0.6) -> Telling:
    """Tells the next of these lines, as far as the map is looked at, a line under it too."""

    def tell(nose_m: float, _: float) -> Optional[float]:
        ahead = [line - nose_m for line in lines_m if -0.06 < line - nose_m < reach_m]
        return min(ahead) if ahead else None

    return tell


@pytest.mark.parametrize("lag_s", [0.0, 0.1, 0.2])
@pytest.mark.parametrize("delay_turns", [0, 1])
@pytest.mark.parametrize("begin_m", [0.25, 0.417, 0.7, 1.0])
def test_it_stands_before_the_line_half_a_second_and_goes_on(
    lag_s: float, delay_turns: int, begin_m: float
) -> None:
    stands = drive(at(begin_m), lag_s, delay_turns)
    assert len(stands) == 1
    assert 0.0 <= begin_m - stands[0].nose_m <= 0.1
    assert stands[0].for_s >= 0.5


def test_each_line_of_a_road_is_stood_at_once() -> None:
    lines = (0.5, 1.1, 1.7)
    stands = drive(at(*lines))
    assert len(stands) == 3
    assert all(0.0 <= line - stand.nose_m <= 0.1 for line, stand in zip(lines, stands))


def test_without_a_line_it_never_slows() -> None:
    assert drive(lambda nose_m, now_s: None) == []


@given(st.integers(0, 40))
def test_one_telling_that_nothing_confirms_stops_nobody(turn: int) -> None:
    assert drive(lambda _, now_s: 0.1 if round(10 * now_s) == turn else None) == []


@given(st.sets(st.integers(0, 40), max_size=8))
def test_a_line_that_is_missed_now_and_then_is_stood_at(missed: "set[int]") -> None:
    known = at(1.0)

    def tell(nose_m: float, now_s: float) -> Optional[float]:
        skipped = round(10 * now_s) in missed and round(10 * now_s) - 1 not in missed
        return None if skipped else known(nose_m, now_s)

    stands = drive(tell)
    assert len(stands) == 1
    assert 0.0 <= 1.0 - stands[0].nose_m <= 0.1


@given(st.lists(st.floats(-0.015, 0.015), min_size=1, max_size=20))
def test_a_line_told_with_an_error_is_stood_at(errors: List[float]) -> None:
    known = at(1.0)

    def tell(nose_m: float, now_s: float) -> Optional[float]:
        told = known(nose_m, now_s)
        return None if told is None else told + errors[round(10 * now_s) % len(errors)]

    stands = drive(tell)
    assert stands
    assert all(0.0 <= 1.0 - stand.nose_m <= 0.1 for stand in stands)
    assert max(stand.for_s for stand in stands) >= 0.5


@given(st.floats(-1.0, 2.0) | st.none(), st.booleans(), st.floats(-1.0, 3.0), st.integers(0, 5))
def test_a_cap_is_never_negative_and_says_why(
    line_m: Optional[float], standing: bool, at_m: float, told: int
) -> None:
    rule, cap = StopLines(at_m=at_m, told=told).after(
        Road(1.0, 0.5, 0.0 if standing else FULL_MPS, line(line_m))
    )
    assert cap.most_mps >= 0.0
    assert (cap.most_mps < FREE) == bool(cap.reason)
    assert isinstance(rule, StopLines)


def before(
    left_m: float, since_s: Optional[float] = None, told: int = 2
) -> "tuple[StopLines, Cap]":
    """What a rule says that knows a line so far before the nose, of which nothing more is told."""
    rule = StopLines(at_m=3.0 + left_m, told=told + (since_s is None), since_s=since_s)
    return rule.after(Road(9.0, 3.0, 0.0))


@pytest.mark.parametrize(
    ("left_m", "most_mps"),
    [
        *[(0.35, 0.6), (0.11, 0.12), (0.0701, 0.0402), (0.069, 0.04), (0.061, 0.04)],
        *[(0.059, 0.0), (0.0, 0.0), (-0.039, 0.0), (-0.041, FREE)],
    ],
)
def test_so_fast_may_it_go_so_far_before_a_line(left_m: float, most_mps: float) -> None:
    """5 cm before it in 0.5 s, never below 4 cm/s, reached at 6 cm; 4 cm behind it none is left."""
    _, cap = before(left_m)
    assert cap.most_mps == pytest.approx(most_mps, abs=1e-4)


@pytest.mark.parametrize(("left_m", "stays"), [(0.099, True), (0.101, False)])
def test_who_stands_stays_up_to_ten_centimetres_before_the_line(left_m: float, stays: bool) -> None:
    _, cap = before(left_m, since_s=8.9)
    assert (cap.most_mps == 0.0) is stays


@pytest.mark.parametrize(("since_s", "goes"), [(7.81, False), (7.79, True)])
def test_it_goes_on_after_being_told_to_stand_for_so_long_and_meets_no_line_there(
    since_s: float, goes: bool
) -> None:
    rule, cap = before(0.05, since_s)
    assert (cap.most_mps == FREE) is goes
    if goes:
        for driven_m, counts in ((3.299, False), (3.301, True)):
            after, _ = rule.after(Road(10.0, driven_m, FULL_MPS, line(0.3)))
            assert (after.told == 1) is counts


def test_it_stands_for_so_long_after_its_wheels_were_told_to() -> None:
    rule, caps = StopLines(at_m=3.05, told=3), []
    for k in range(40):
        told_mps = 0.05 if k < 20 else 0.0  # a ramp, or a turn that came late
        rule, cap = rule.after(Road(0.1 * k, 3.0, told_mps, line(0.05)))
        caps.append(cap.most_mps)
    assert caps[:31] == [0.0] * 31
    assert caps[32] == FREE


@pytest.mark.parametrize(("apart_m", "told"), [(0.119, 4), (0.121, 1), (-0.119, 4), (-0.121, 1)])
def test_two_tellings_so_near_to_each_other_mean_one_line(apart_m: float, told: int) -> None:
    rule, _ = StopLines(at_m=3.5, told=3).after(Road(9.0, 3.0, FULL_MPS, line(0.5 + apart_m)))
    assert rule.told == told
    assert rule.at_m == pytest.approx(3.5 + apart_m)


def test_a_line_counts_from_its_second_telling_and_is_kept_for_five_turns_at_most() -> None:
    rule = StopLines()
    slowed, told = [], [0.3] * 8 + [None] * 6
    for line_m in told:
        rule, cap = rule.after(Road(9.0, 3.0, FULL_MPS, line(line_m)))
        slowed.append(cap.most_mps < FREE)
    assert slowed == [False] + [True] * 7 + [True] * 3 + [False] * 3


class Chase(NamedTuple):
    """How a robot behind another drove."""

    least_m: float  # between nose and tail
    way_m: float


def chase(
    leader_mps: List[float], free_m: float, lag_s: float, delay_turns: int, errors: List[float]
) -> Chase:
    """Follow what moves so fast in each turn, or stops dead; full speed wherever it is allowed."""
    speed, sent, least_m, way_m = FULL_MPS, [FULL_MPS] * (delay_turns + 1), free_m, 0.0
    for k, ahead_mps in enumerate(leader_mps):
        told_m = free_m + errors[k % len(errors)]
        seen = RoadAhead(told_m, 0.01, coming_mps=-ahead_mps)
        _, cap = KeepApart().after(Road(0.1 * k, way_m, sent[-1], seen))
        sent.append(min(FULL_MPS, cap.most_mps))
        for _ in range(10):
            speed += (sent[-1 - delay_turns] - speed) * min(1.0, 0.01 / max(lag_s, 0.01))
            free_m += 0.01 * (ahead_mps - speed)
            way_m += 0.01 * speed
            least_m = min(least_m, free_m)
    return Chase(least_m, way_m)


SOMEHOW = st.lists(st.sampled_from([0.0, 0.0, 0.1, 0.3]), min_size=1, max_size=12)
ERRORS = st.lists(st.floats(-0.015, 0.015), min_size=1, max_size=8)


@given(
    SOMEHOW, st.floats(0.22, 1.0), st.sampled_from([0.0, 0.1, 0.2]), st.sampled_from([0, 1]), ERRORS
)
def test_nobody_is_hit_who_stops_dead_at_any_time(
    legs: List[float], free_m: float, lag_s: float, delay_turns: int, errors: List[float]
) -> None:
    leader_mps = [speed for speed in legs for _ in range(7)] + [0.0] * 20
    assert chase(leader_mps, free_m, lag_s, delay_turns, errors).least_m > 0.0


@pytest.mark.parametrize("lag_s", [0.0, 0.1, 0.2])
@pytest.mark.parametrize("delay_turns", [0, 1])
def test_it_stops_before_a_duck_that_appears_a_quarter_of_a_metre_ahead(
    lag_s: float, delay_turns: int
) -> None:
    free_m = 0.25 - 0.066 - 0.03  # from the axle to the duck's middle: less the nose, half a duck
    assert chase([0.0] * 40, free_m, lag_s, delay_turns, [0.0]).least_m > 0.0


@pytest.mark.parametrize("seed", range(8))
def test_who_stands_before_a_thing_does_not_creep_into_it_by_poses_that_err(seed: int) -> None:
    """Errors of 4 cm that last for 2 s, of two poses of 3 cm; for half a second none is told."""
    rng, rule, free_m, speed, keep = random.Random(seed), KeepApart(), 0.5, 0.0, math.exp(-0.05)
    error_m = rng.gauss(0.0, 0.042)
    for k in range(600):
        error_m = keep * error_m + math.sqrt(1.0 - keep**2) * rng.gauss(0.0, 0.042)
        told_m = math.inf if 300 <= k < 305 else free_m + error_m
        rule, cap = rule.after(Road(0.1 * k, 0.0, 0.0, RoadAhead(told_m, 0.03)))
        speed += 0.5 * (min(FULL_MPS, cap.most_mps) - speed)
        free_m -= 0.1 * speed
    assert 0.0 < free_m < 0.2
    for k in range(10):
        rule, cap = rule.after(Road(60.0 + 0.1 * k, 0.0, 0.0, RoadAhead(free_sigma_m=0.03)))
    assert cap == Cap(), "it was taken away"


TELLINGS = st.tuples(
    st.one_of(st.just(math.inf), st.floats(-0.1, 0.6)),
    st.sampled_from([0.0, 0.03, 0.079, 0.081, 0.2]),
    st.sampled_from([-0.1, 0.0, 0.0, 0.1]),
)


@example([((0.0, 0.0, -0.1), 16), ((0.25, 0.081, -0.1), 16), ((0.125, 0.081, -0.1), 1)])
@given(st.lists(st.tuples(TELLINGS, st.integers(1, 40)), min_size=1, max_size=8))
def test_nearer_than_is_sure_goes_only_who_stood_before_what_it_has_not_made_out(
    legs: List[Tuple[Tuple[float, float, float], int]],
) -> None:
    rule, stood, now_s = KeepApart(), 0, 5.0
    for free_m, sigma_m, coming_mps in (told for told, turns in legs for _ in range(turns)):
        rule, cap = rule.after(Road(now_s, 0.0, 0.0, RoadAhead(free_m, sigma_m, coming_mps)))
        now_s += 0.1
        spare_m = (4.0 if stood else 2.0) * sigma_m + 0.04
        sure_mps = (free_m - spare_m) / 0.9 - max(0.0, coming_mps)
        sure_mps = sure_mps if sure_mps >= 0.02 else 0.0
        if cap.most_mps > sure_mps + 1e-9:
            assert stood >= 30
            assert sigma_m > 0.08
            assert 0.02 <= cap.most_mps <= 0.04
            assert (free_m - 0.08) / 0.9 - max(0.0, coming_mps) >= cap.most_mps - 1e-9
        stood = 0 if cap.most_mps >= sure_mps - 1e-9 > 0.0 else stood + 1


@pytest.mark.parametrize(
    ("free_m", "sigma_m", "most_mps"),
    [(0.3, 0.16, 0.04), (0.2, 0.081, 0.04), (0.11, 0.1, 0.0333), (0.097, 0.1, 0.0), (0.1, 0.08, 0)],
)
def test_it_goes_after_three_seconds_slowly_and_not_up_to_it(
    free_m: float, sigma_m: float, most_mps: float
) -> None:
    seen, rule, caps = RoadAhead(free_m, sigma_m), KeepApart(), []
    for k in range(60):  # of a second and a half nothing is seen: it goes on to wait
        there = RoadAhead(free_sigma_m=sigma_m) if k % 15 == 7 else seen
        rule, cap = rule.after(Road(50.0 + 0.1 * k, 0.0, 0.0, there))
        caps.append(cap.most_mps)
    assert max(caps[:30]) == 0.0
    assert max(caps[31:]) == pytest.approx(most_mps, abs=1e-4)


def test_who_walks_towards_it_is_not_met_at_speed() -> None:
    """It stands before what comes on; that it is then run into is not its doing."""
    for coming_mps, most_mps in ((0.3, 0.1), (0.1, 0.3), (-0.2, 0.4)):
        seen = RoadAhead(free_m=0.4, coming_mps=coming_mps)
        assert KeepApart().after(Road(0.0, 0.0, 0.3, seen))[1].most_mps == pytest.approx(most_mps)


def test_behind_a_robot_at_full_speed_the_way_is_kept_and_nobody_dawdles() -> None:
    followed = chase([0.25] * 100, 0.5, 0.1, 0, [0.0])
    assert followed.way_m > 0.25 * 10.0
    assert chase([0.3] * 100, math.inf, 0.1, 0, [0.0]).way_m == pytest.approx(3.0, abs=0.01)


@pytest.mark.parametrize("free_m", [math.nan, -0.1, 0.0, -math.inf])
def test_no_way_and_no_number_are_no_way(free_m: float) -> None:
    cap = KeepApart().after(Road(0.0, 0.0, 0.3, RoadAhead(free_m)))[1]
    assert cap.most_mps == 0.0
    assert ("nothing tells" in cap.reason) is math.isnan(free_m)
    with pytest.raises(ContractError, match="free_sigma_m: expected 0 m or more"):
        RoadAhead(free_sigma_m=math.nan)


@pytest.mark.parametrize(
    ("red", "line_m", "most_mps"),
    [
        (True, 0.35, 0.6),
        (True, 0.05, 0.0),
        (True, -0.05, FREE),
        (True, None, FREE),
        (False, 0.05, FREE),
    ],
)
def test_a_red_light_holds_before_its_line_and_no_other_does(
    red: bool, line_m: Optional[float], most_mps: float
) -> None:
    seen = RoadAhead(line_m=line_m, red_light=red)
    assert Lights().after(Road(0.0, 0.0, 0.3, seen))[1].most_mps == pytest.approx(most_mps)


def test_who_stood_before_something_has_not_forgotten_it_when_nothing_was_told_for_a_turn() -> None:
    rule = KeepApart()
    for free_m, goes in ((0.05, False), (0.15, False), (math.nan, False), (0.15, False)):
        rule, cap = rule.after(Road(0.0, 0.0, 0.0, RoadAhead(free_m, 0.03)))
        assert (cap.most_mps > 0.0) is goes
    assert KeepApart().after(Road(0.0, 0.0, 0.0, RoadAhead(0.15, 0.03)))[1].most_mps > 0.0


@pytest.mark.parametrize(("sigma_m", "turns"), [(0.01, 9), (0.0, 0)])
def test_who_stood_goes_after_a_second_of_nothing_or_at_once_where_nothing_errs(
    sigma_m: float, turns: int
) -> None:
    rule, cap = KeepApart().after(Road(0.0, 0.0, 0.0, RoadAhead(0.03)))
    assert cap.most_mps == 0.0
    caps = []
    for k in range(1, 12):
        rule, cap = rule.after(Road(0.1 * k, 0.0, 0.0, RoadAhead(FREE, sigma_m)))
        caps.append(cap.most_mps)
    assert caps == [0.0] * turns + [FREE] * (11 - turns)


def test_what_a_rule_remembers_goes_on() -> None:
    rules, _ = govern([Counting(), Counting(4)], Road(0.0, 0.0, FULL_MPS))
    assert rules == (Counting(1), Counting(5))


def test_the_rules_are_those_that_are_asked_for_and_no_others() -> None:
    assert Rules().chain() == ()
    assert Rules(stop_lines=True).chain() == (StopLines(),)
    assert Rules(headway=True).chain() == (KeepApart(),)
    assert Rules(True, True, True).chain() == (KeepApart(), StopLines(), FirstCome())
    for stop_lines, headway in ((True, False), (False, True), (False, False)):
        with pytest.raises(ConfigError, match=r"rules\.right_of_way"):
            Rules(stop_lines, headway, right_of_way=True)


def test_the_nose_is_where_it_was_measured() -> None:
    assert NOSE_M == 0.066  # before the axle, as in the drawing


def test_what_comes_at_nobody_knows_which_speed_is_stood_for() -> None:
    _, cap = KeepApart().after(Road(0.0, 0.0, FULL_MPS, RoadAhead(1.0, 0.0, math.nan)))
    assert cap.most_mps == 0.0


@pytest.mark.parametrize("left_m", [0.059, 0.03, 0.0, -0.03])
def test_at_a_red_light_it_stands_and_does_not_roll_back(left_m: float) -> None:
    ahead = RoadAhead(line_m=left_m, red_light=True)
    assert Lights().after(Road(0.0, 0.0, 0.0, ahead))[1].most_mps == 0.0


def test_who_stands_at_a_line_stands_on_though_the_next_one_is_told() -> None:
    rule: StopLines = StopLines()
    for turn, line_m in enumerate((0.05, 0.05, 0.05, 0.6, 0.6, 0.6)):
        rule, cap = rule.after(Road(0.1 * turn, 0.0, 0.0, RoadAhead(line_m=line_m)))
    assert cap == Cap(0.0, "it stands at a stop line")
