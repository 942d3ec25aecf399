"""The registers are read back: whoever else writes to the chip is noticed."""

from __future__ import annotations

import pytest

from robot.errors import HardwareError
from robot.hat.config import HatConfig
from tests.robot.hat.rig import ALL_OFF, Rig, make_rig


def another_writes(rig: Rig, data: bytes) -> None:
    rig.bus.write(0x6F, data)


@pytest.mark.parametrize("microsteps", [1, 2, 4, 16])
@pytest.mark.parametrize("wheels", [(0.1, 0.1), (0.05, 0.0), (0.0, 0.0)])
def test_coils_that_another_program_switched_off_stay_off(wheels: tuple, microsteps: int) -> None:
    rig = make_rig(HatConfig(microsteps=microsteps, bus_hz=1_000_000, max_speed_mps=0.1))
    with rig.driver:
        rig.drive(0.1, 0.1, 1.0)
        rig.drive(*wheels, 0.2)
        another_writes(rig, ALL_OFF)
        with pytest.raises(HardwareError, match="another program released or wrote"):
            rig.drive(*wheels, 0.25)
        assert not rig.hat.chip.outputs.any_high
        before = rig.rolled_m
        for _ in range(5):
            with pytest.raises(HardwareError, match="the motors are off since"):
                rig.drive(0.1, 0.1, 0.1)
        assert not rig.hat.chip.outputs.any_high
        assert rig.rolled_m == pytest.approx(before, abs=0.02)


@pytest.mark.parametrize("channel", range(2, 14))
def test_a_channel_that_another_program_writes_while_the_robot_stands_is_noticed(
    channel: int,
) -> None:
    rig = make_rig()
    with rig.driver:
        rig.drive(0.1, 0.1, 1.0)
        rig.come_to_rest()
        another_writes(rig, bytes((0x06 + 4 * channel, 0, 0, 0x33, 0x03)))
        with pytest.raises(HardwareError, match=f"wrote channel {channel} "):
            rig.wait(1.5)
        assert not rig.hat.chip.outputs.any_high


def test_looking_takes_the_bus_a_fiftieth_of_its_time() -> None:
    rig = make_rig()
    with rig.driver:
        rig.drive(0.3, 0.3, 1.0)
        rig.bus.log.clear()
        rig.drive(0.3, 0.3, 4.0)
        reads = [t for t in rig.bus.log if t.read_count]
        assert 76 <= len(reads) <= 90, "one look each 50 ms; the modes are three reads"
        bits = sum(9 * (3 + t.read_count) + 3 for t in reads)
        assert bits / 100_000 < 0.02 * 4.0
        assert {t.data[0] for t in reads} >= {0x00, 0x01, 0xFE, *range(0x0E, 0x3E, 4)}
