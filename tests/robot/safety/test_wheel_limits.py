from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from robot.contract import ACTION_WHEELS, CONTROL_DT_S, MAX_WHEEL_MPS
from robot.errors import ContractError
from robot.geometry import STILL, WheelSpeeds
from robot.safety.governors import Cap
from robot.safety.wheel_limits import MAX_WHEEL_MPS2, Drive, limit_rate, limit_speed

SPEEDS = st.builds(WheelSpeeds, st.floats(-9.0, 9.0), st.floats(-9.0, 9.0))
BROKEN = st.sampled_from((math.nan, math.inf, -math.inf))


@given(SPEEDS, st.floats(0.01, MAX_WHEEL_MPS))
def test_speed_is_limited_along_the_same_curve(wanted: WheelSpeeds, most: float) -> None:
    allowed = limit_speed(wanted, most)
    assert max(map(abs, allowed)) <= most * (1 + 1e-12)
    # Same direction: the cross product of the two pairs vanishes, and no sign flips.
    assert allowed.left_mps * wanted.right_mps == pytest.approx(
        allowed.right_mps * wanted.left_mps, abs=1e-12
    )
    assert all(a * w >= 0.0 for a, w in zip(allowed, wanted))
    assert limit_speed(allowed, most) == pytest.approx(allowed)


@given(SPEEDS, SPEEDS, st.floats(0.0, 1.0))
def test_rate_is_limited_and_never_overshoots(
    wanted: WheelSpeeds, last: WheelSpeeds, dt_s: float
) -> None:
    allowed, most = limit_rate(wanted, last, dt_s), MAX_WHEEL_MPS2
    for a, w, v in zip(allowed, wanted, last):
        assert abs(a - v) <= most * dt_s + 1e-9
        assert min(v, w) - 1e-9 <= a <= max(v, w) + 1e-9
        if abs(w - v) <= most * dt_s:
            assert a == pytest.approx(w)


@pytest.mark.parametrize("last", [STILL, *ACTION_WHEELS])
@pytest.mark.parametrize("wanted", ACTION_WHEELS)
def test_limits_leave_every_change_of_action_free(wanted: WheelSpeeds, last: WheelSpeeds) -> None:
    assert limit_speed(wanted) == wanted
    assert limit_rate(wanted, last, CONTROL_DT_S) == pytest.approx(wanted)


def test_a_reversal_at_full_speed_is_not_free() -> None:
    fast = WheelSpeeds(MAX_WHEEL_MPS, MAX_WHEEL_MPS)
    back = limit_rate(WheelSpeeds(-MAX_WHEEL_MPS, MAX_WHEEL_MPS), fast, CONTROL_DT_S)
    assert back.left_mps == pytest.approx(MAX_WHEEL_MPS - MAX_WHEEL_MPS2 * CONTROL_DT_S)


def test_a_cap_brakes_no_wheel_harder_than_its_rate() -> None:
    """A quarter more than from rest to 0.3459 m/s in a tenth of a second."""
    fast = WheelSpeeds(0.3, 0.3)
    told = Drive(fast, fast, 0.02, Cap(0.0)).limited(0.5)
    assert told == pytest.approx((0.3 - 0.02 * 4.32375,) * 2)


@given(BROKEN)
def test_what_is_not_finite_is_refused(broken: float) -> None:
    for wheels in (WheelSpeeds(broken, 0.0), WheelSpeeds(0.0, broken)):
        with pytest.raises(ContractError, match="expected two finite numbers"):
            limit_speed(wheels)
        with pytest.raises(ContractError, match="expected two finite numbers"):
            limit_rate(wheels, STILL, 0.1)
        with pytest.raises(ContractError, match="expected two finite numbers"):
            limit_rate(STILL, wheels, 0.1)
    with pytest.raises(ContractError, match="expected a time step"):
        limit_rate(STILL, STILL, broken)
