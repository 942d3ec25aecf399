import math
from typing import NamedTuple

import pytest

from robot.hat import config as coils

MICROSTEPS = (1, 2, 4, 8, 16)
# AIN2, BIN1, AIN1, BIN2 of the published half-step table.
HALF_STEPS = ["1000", "1100", "0100", "0110", "0010", "0011", "0001", "1001"]


class Levels(NamedTuple):
    """In the order of the channels of the first port: PWMA is 8, PWMB is 13."""

    pwma: float
    ain2: float
    ain1: float
    bin1: float
    bin2: float
    pwmb: float


def ring_levels(position: float, microsteps: int, duty: float) -> Levels:
    return Levels(*coils.ring_levels(position, microsteps, duty))


def ring(levels: Levels) -> str:
    inputs = (levels.ain2, levels.bin1, levels.ain1, levels.bin2)
    assert set(inputs) <= {0.0, 1.0}, "the inputs are held: duties belong on PWMA and PWMB"
    return "".join(str(int(level)) for level in inputs)


def field_angle(levels: Levels) -> float:
    a, b = levels.pwma * (levels.ain2 - levels.ain1), levels.pwmb * (levels.bin1 - levels.bin2)
    return math.atan2(b, a)


@pytest.mark.parametrize("duty", [0.1, 0.3, 1.0])
def test_half_steps_follow_the_published_table(duty: float) -> None:
    rows = [ring_levels(i, 2, duty) for i in range(8)]
    assert [ring(row) for row in rows] == HALF_STEPS
    assert {(row.pwma, row.pwmb) for row in rows} == {(duty, duty)}, "steps change no PWM input"


def test_full_steps_use_two_coils_at_a_time() -> None:
    assert [ring(ring_levels(i, 1, 0.7)) for i in range(4)] == ["1100", "0110", "0011", "1001"]


@pytest.mark.parametrize("microsteps", MICROSTEPS)
def test_field_turns_by_equal_angles_and_repeats(microsteps: int) -> None:
    size = 4 * microsteps
    for i in range(-size, size):
        here, there = ring_levels(i, microsteps, 1.0), ring_levels(i + 1, microsteps, 1.0)
        turn = math.remainder(field_angle(there) - field_angle(here), 2 * math.pi)
        assert turn == pytest.approx(2 * math.pi / size)
        assert ring_levels(i + size, microsteps, 1.0) == here


@pytest.mark.parametrize("microsteps", MICROSTEPS)
@pytest.mark.parametrize("duty", [0.0, 0.3, 1.0])
def test_duty_limits_every_coil_and_never_both_ends_of_a_winding(
    microsteps: int, duty: float
) -> None:
    for i in range(4 * microsteps):
        levels = ring_levels(i, microsteps, duty)
        assert max(levels.pwma, levels.pwmb) == pytest.approx(duty)
        assert levels.ain1 * levels.ain2 == 0.0
        assert levels.bin1 * levels.bin2 == 0.0
        ring(levels)
