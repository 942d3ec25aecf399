"""Bridges and windings against the data sheet and against the differential equation itself."""

import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sim_pybullet.virtual.pca9685_registers import PwmOutputs
from sim_pybullet.virtual.rotor import (
    BridgeState,
    CoilDrive,
    Span,
    bridge_spans,
    bridge_state,
    coil_drive,
    relax,
)

CW, CCW, BRAKE, STOP = (
    BridgeState.CW,
    BridgeState.CCW,
    BridgeState.SHORT_BRAKE,
    BridgeState.STOP,
)
PERIOD_S = 4096 * 4 / 25e6  # at the fastest pre-scale
time_constants_s = st.floats(0.3e-3, 3e-3)
periods = st.lists(
    st.tuples(st.integers(1, 9), st.sampled_from([CW, CCW, BRAKE, STOP])), min_size=1, max_size=4
).map(lambda parts: tuple(Span(n / sum(m for m, _ in parts), state) for n, state in parts))


def test_bridge_function_table() -> None:
    """Written as the data sheet prints it, with STBY high: IN1, IN2, PWM, outputs."""
    rows = """
    H H H brake
    H H L brake
    L H H ccw
    L H L brake
    H L H cw
    H L L brake
    L L H stop
    L L L stop
    """
    names = {"brake": BRAKE, "ccw": CCW, "cw": CW, "stop": STOP}
    for row in rows.strip().splitlines():
        *levels, name = row.split()
        in1, in2, pwm = (level == "H" for level in levels)
        assert bridge_state(in1, in2, pwm) is names[name], row


@given(st.integers(1, 4095))
def test_a_duty_on_an_input_stops_and_one_on_pwm_brakes(counts: int) -> None:
    led = bytearray((0, 0, 0, 0x10) * 16)
    duty, high = bytes((0, 0, counts & 0xFF, counts >> 8)), bytes((0, 0x10, 0, 0))
    led[0:4], led[8:12] = duty, high  # IN1, PWM
    spans = bridge_spans(PwmOutputs.from_registers(bytes(led)), 0, 1, 2)
    assert spans == ((counts / 4096, CW), (1 - counts / 4096, STOP))
    led[0:4], led[8:12] = high, duty
    spans = bridge_spans(PwmOutputs.from_registers(bytes(led)), 0, 1, 2)
    assert spans == ((counts / 4096, CW), (1 - counts / 4096, BRAKE))


def mean_by_small_steps(spans: tuple, time_constant_s: float) -> float:
    """Euler's method with a diode, from rest until the period repeats itself."""
    steps, current, mean = 2000, 0.0, 0.0
    for _ in range(math.ceil(12 * time_constant_s / PERIOD_S) + 2):
        mean = 0.0
        for share, state in spans:
            count = max(round(share * steps), 1)
            dt_s = share * PERIOD_S / count
            for _ in range(count):
                pull = {CW: 1.0, CCW: -1.0, BRAKE: 0.0, STOP: -math.copysign(1.0, current)}[state]
                after = current + dt_s / time_constant_s * (pull - current)
                current = 0.0 if state is STOP and after * current <= 0.0 else after
                mean += current * dt_s / PERIOD_S
    return mean


@given(periods, time_constants_s)
@settings(max_examples=25, deadline=None)
def test_mean_currents_solve_the_differential_equation(
    spans: tuple, time_constant_s: float
) -> None:
    drive = coil_drive(spans, PERIOD_S, time_constant_s)
    assert drive.current == pytest.approx(mean_by_small_steps(spans, time_constant_s), abs=2e-3)
    assert drive.closed == pytest.approx(sum(s.share for s in spans if s.state is not STOP))


@pytest.mark.parametrize(
    ("duty", "time_constant_s", "left"),
    [(0.3, 0.3e-3, 0.12), (0.3, 3e-3, 0.02), (0.5, 0.3e-3, 0.27), (0.5, 3e-3, 0.05)],
)
def test_without_a_brake_between_the_pulses_hardly_any_current_is_left(
    duty: float, time_constant_s: float, left: float
) -> None:
    fast = (Span(duty, CW), Span(1 - duty, STOP))
    assert coil_drive(fast, PERIOD_S, time_constant_s).current == pytest.approx(left, abs=0.005)
    slow = (Span(duty, CW), Span(1 - duty, BRAKE))
    assert coil_drive(slow, PERIOD_S, time_constant_s).current == pytest.approx(duty)


@given(st.floats(-1.0, 1.0), st.floats(-1.0, 1.0))
def test_a_braked_current_decays_slowly_and_a_released_one_never_turns_round(
    current: float, target: float
) -> None:
    keep = math.exp(-0.5)
    assert relax(current, CoilDrive(target, 1.0), 1.0) == pytest.approx(current)
    assert relax(current, CoilDrive(0.0, 1.0), keep) == pytest.approx(current * keep)
    released = relax(current, CoilDrive(0.0, 0.0), keep)
    assert released * current >= 0.0
    assert abs(released) <= abs(current) * keep + 1e-12
