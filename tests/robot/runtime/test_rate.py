from __future__ import annotations

from types import SimpleNamespace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from robot.errors import HardwareError
from robot.runtime.timing import RateKeeper, Watchdog
from tests.robot.clocks import FakeClock


@given(st.lists(st.floats(0.0, 0.5), min_size=1, max_size=30))
def test_turns_begin_on_the_grid_or_as_soon_as_they_can(work_s: list) -> None:
    clock = FakeClock(0.0)
    rate = RateKeeper(0.1, clock)
    for work in work_s:
        lag_s = rate.wait()
        deadline_s = clock.now_s - lag_s
        assert abs(deadline_s / 0.1 - round(deadline_s / 0.1)) < 1e-6
        clock.now_s += work
    rate.wait()
    assert clock.now_s <= 0.1 * sum(int(work / 0.1) + 1 for work in work_s) + 1e-6


def test_no_drift_and_no_lag_when_work_is_short() -> None:
    clock = FakeClock(5.0)
    rate = RateKeeper(0.1, clock)
    for _ in range(1000):
        assert rate.wait() < 1e-9
        clock.now_s += 0.03
    assert abs(clock.now_s - (5.0 + 99.9 + 0.03)) < 1e-6


def test_missed_turns_are_skipped_not_caught_up() -> None:
    clock = FakeClock(0.0)
    rate = RateKeeper(0.1, clock)
    rate.wait()
    clock.now_s += 0.55
    assert abs(rate.wait() - 0.45) < 1e-9
    rate.wait()
    assert abs(clock.now_s - 0.6) < 1e-9


def test_a_clock_that_goes_back_does_not_stall_the_loop() -> None:
    clock = FakeClock(1000.0)
    rate = RateKeeper(0.1, clock)
    rate.wait()
    clock.now_s -= 500.0
    rate.wait()
    rate.wait()
    assert clock.now_s < 500.3
    clock.now_s -= 1.0
    rate.wait()
    assert clock.now_s < 499.4


@pytest.mark.parametrize(("period_s", "good"), [(0.1, 6), (0.01, 51), (1.0, 5)])
def test_a_watchdog_that_never_looks_is_missed_after_five_turns_and_half_a_second(
    period_s: float, good: int
) -> None:
    watchdog = Watchdog(lambda: None)
    ticks = [SimpleNamespace(time_s=period_s * i) for i in range(good + 1)]
    for tick in ticks[:good]:
        watchdog.on_tick(tick)  # type: ignore[arg-type]
    with pytest.raises(HardwareError, match=r"expected a look every 0\.05 s"):
        watchdog.on_tick(ticks[good])  # type: ignore[arg-type]
