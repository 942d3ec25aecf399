import math

import pytest

from robot.hat.coils import MICROSTEPS, ring_levels, ring_size

HALF_STEPS = ["1000", "1100", "0100", "0110", "0010", "0011", "0001", "1001"]


def field_angle(levels: tuple) -> float:
    return math.atan2(levels[1] - levels[3], levels[0] - levels[2])


def test_half_steps_follow_the_published_table() -> None:
    rows = ["".join(str(int(x)) for x in ring_levels(i, 2, 1.0)) for i in range(8)]
    assert rows == HALF_STEPS


def test_full_steps_use_two_coils_at_a_time() -> None:
    assert [sum(ring_levels(i, 1, 1.0)) for i in range(4)] == [2.0] * 4


@pytest.mark.parametrize("microsteps", MICROSTEPS)
def test_field_turns_by_equal_angles_and_repeats(microsteps: int) -> None:
    size = ring_size(microsteps)
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
    for i in range(ring_size(microsteps)):
        ain2, bin1, ain1, bin2 = ring_levels(i, microsteps, duty)
        assert max(ain2, bin1, ain1, bin2) == pytest.approx(duty)
        assert ain1 * ain2 == 0.0
        assert bin1 * bin2 == 0.0
