import math
from typing import List, Tuple

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from robot.geometry import WheelSpeeds
from robot.hat.config import HatConfig
from robot.hat.stepping import StepPlanner
from tests.robot.hat.rig import full_step_m, speeds

CONFIG = HatConfig()
SPEEDS = st.floats(-CONFIG.max_speed_mps, CONFIG.max_speed_mps)
profile = st.lists(st.tuples(st.floats(0.001, 0.6), SPEEDS, SPEEDS), min_size=1, max_size=8)


def step_times(planner: StepPlanner, until_s: float) -> List[Tuple[float, int, int]]:
    """Every step with its exact deadline."""
    steps = []
    while planner.deadline_s is not None and planner.deadline_s <= until_s:
        time_s = planner.deadline_s
        left, right = planner.advance(time_s)
        steps.append((time_s, left, right))
    return steps


@pytest.mark.slow
def test_speed_is_reached_exactly_and_has_no_drift_over_100_000_steps() -> None:
    planner = StepPlanner(CONFIG, 0.0)
    planner.set_speeds(0.0, WheelSpeeds(0.3, 0.3))
    step_times(planner, 5.0)
    assert speeds(planner, 5.0) == pytest.approx((0.3, 0.3), abs=1e-15)
    first = planner.deadline_s
    assert first is not None
    period_s = CONFIG.step_m / 0.3
    for k in range(100_000):
        deadline = planner.deadline_s
        assert deadline is not None
        assert abs(deadline - (first + k * period_s)) < 1e-7
        assert planner.advance(deadline) == (1, 1)


@given(profile)
@settings(deadline=None, max_examples=60)
def test_ramps_keep_to_acceleration_and_start_stop_speed(plan: list) -> None:
    planner, time_s, dt_s = StepPlanner(CONFIG, 0.0), 0.0, 0.02
    slow = CONFIG.start_stop_mps * (1 + 1e-9)
    for duration_s, left, right in plan:
        planner.set_speeds(time_s, WheelSpeeds(left, right))
        for _ in range(int(duration_s / dt_s) + 1):
            last, now = speeds(planner, time_s), speeds(planner, time_s + dt_s)
            for before, after in zip(last, now):
                # Inside the start-stop range a speed may jump; outside it may only ramp.
                change = abs(max(abs(after), slow) - max(abs(before), slow))
                assert change <= CONFIG.acceleration_mps2 * dt_s + 1e-9
                assert before * after >= 0 or max(abs(before), abs(after)) <= slow + change
            time_s += dt_s


@given(profile)
@settings(deadline=None, max_examples=60)
def test_steps_follow_the_integral_of_speed_one_at_a_time(plan: list) -> None:
    planner, time_s = StepPlanner(CONFIG, 0.0), 0.0
    last = [(-1.0, 0), (-1.0, 0)]
    for duration_s, left, right in plan:
        planner.set_speeds(time_s, WheelSpeeds(left, right))
        time_s += duration_s
        for moment_s, *steps in step_times(planner, time_s):
            for wheel, step in enumerate(steps):
                if step:
                    before_s, direction = last[wheel]
                    gap_s = moment_s - before_s
                    assert gap_s >= CONFIG.step_m / CONFIG.max_speed_mps - 1e-9
                    if direction == -step:
                        # A rest, and then the way back at hardly more than start-stop speed.
                        assert gap_s >= 1.7 * CONFIG.step_m / CONFIG.start_stop_mps
                    last[wheel] = (moment_s, step)
        for ramp, count in zip(planner._wheels, planner.counts):
            assert abs(ramp.at(time_s)[0] - count) <= 1.0 + 1e-9


def test_a_stop_in_between_does_not_spare_the_rest_before_turning_back() -> None:
    planner = StepPlanner(CONFIG, 0.0)
    planner.set_speeds(0.0, WheelSpeeds(0.05, 0.05))
    last_s = step_times(planner, 1.0)[-1][0]
    planner.set_speeds(last_s, WheelSpeeds(0.0, 0.0))
    planner.set_speeds(last_s + 0.001, WheelSpeeds(-0.05, 0.05))
    left_s = next(t for t, left, _ in step_times(planner, 2.0) if left)
    assert left_s - last_s == pytest.approx(2 * CONFIG.step_m / CONFIG.start_stop_mps)


@given(profile)
@settings(deadline=None, max_examples=60)
def test_deadlines_never_run_backwards(plan: list) -> None:
    planner, time_s, last_s = StepPlanner(CONFIG, 0.0), 0.0, 0.0
    for duration_s, left, right in plan:
        planner.set_speeds(time_s, WheelSpeeds(left, right))
        for moment_s, *_ in step_times(planner, time_s + duration_s):
            assert moment_s >= last_s - 1e-9
            assert moment_s >= time_s - 1e-9
            last_s = moment_s
        time_s += duration_s


def test_a_small_lateness_is_caught_up() -> None:
    planner = StepPlanner(CONFIG, 0.0)
    planner.set_speeds(0.0, WheelSpeeds(0.3, 0.3))
    step_times(planner, 2.0)
    due_s = planner.deadline_s
    assert due_s is not None
    planner.advance(due_s + 0.003)
    assert planner.deadline_s == pytest.approx(due_s + CONFIG.step_m / 0.3)


def test_a_larger_lateness_delays_both_wheels() -> None:
    planner = StepPlanner(CONFIG, 0.0)
    planner.set_speeds(0.0, WheelSpeeds(0.3, 0.05))
    step_times(planner, 2.0)
    due_s, slow = planner.deadline_s, planner._wheels[1].next_crossing(planner.counts.right)
    assert due_s is not None
    assert slow is not None
    full_step_s = full_step_m(CONFIG) / 0.3
    planner.advance(due_s + 0.8 * full_step_s)
    assert planner.deadline_s == pytest.approx(due_s + (0.3 + 0.5) * full_step_s)
    later = planner._wheels[1].next_crossing(planner.counts.right)
    assert later is not None
    assert later.time_s == pytest.approx(slow.time_s + 0.3 * full_step_s)
    assert planner.stalls == 0


def test_a_stall_starts_again_slowly_instead_of_hurrying() -> None:
    planner = StepPlanner(CONFIG, 0.0)
    planner.set_speeds(0.0, WheelSpeeds(0.3, 0.3))
    step_times(planner, 2.0)
    assert planner.advance(2.5) == (1, 1)
    assert planner.stalls == 2
    assert speeds(planner, 2.5) == pytest.approx((CONFIG.start_stop_mps,) * 2)
    steps = step_times(planner, 2.7)
    gaps = [b[0] - a[0] for a, b in zip(steps, steps[1:])]
    assert gaps == sorted(gaps, reverse=True)
    assert steps[0][0] >= 2.5 + 0.5 * CONFIG.step_m / CONFIG.start_stop_mps


def test_freeze_stops_at_once_and_standing_has_no_deadline() -> None:
    planner = StepPlanner(CONFIG, 0.0)
    assert planner.deadline_s is None
    planner.set_speeds(0.0, WheelSpeeds(0.3, -0.3))
    step_times(planner, 1.0)
    planner.freeze(1.0)
    assert planner.deadline_s is None
    assert speeds(planner, 1.0) == (0.0, 0.0)
    assert math.copysign(1, planner.counts.left) == -math.copysign(1, planner.counts.right)


def test_who_is_frozen_between_two_steps_goes_on_from_there() -> None:
    rate = 0.05 / CONFIG.step_m  # at a speed that needs no ramp
    planner = StepPlanner(CONFIG, 0.0)
    planner.set_speeds(0.0, WheelSpeeds(0.05, 0.05))
    step_times(planner, 10.6 / rate)
    assert planner.counts == (10, 10)
    planner.freeze(10.6 / rate)
    assert planner.deadline_s is None
    planner.set_speeds(5.0, WheelSpeeds(0.05, 0.05))
    assert planner.deadline_s == pytest.approx(5.0 + 0.4 / rate)


@pytest.mark.parametrize(("late_full_steps", "stalls"), [(0.9, 0), (1.1, 1)])
def test_a_field_that_stood_for_more_than_a_full_step_has_stopped_its_rotor(
    late_full_steps: float, stalls: int
) -> None:
    planner = StepPlanner(CONFIG, 0.0)
    planner.set_speeds(0.0, WheelSpeeds(0.2, 0.0))
    step_times(planner, 2.0)
    due_s = planner.deadline_s
    assert due_s is not None
    late_s = due_s + late_full_steps * full_step_m(CONFIG) / 0.2
    planner.advance(late_s)
    assert planner.stalls == stalls
    assert speeds(planner, late_s)[0] == pytest.approx(CONFIG.start_stop_mps if stalls else 0.2)
