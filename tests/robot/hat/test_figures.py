"""The motor side's figures as literals, from data sheets and from docs/wiring.md.

No constant of the driver is imported here: one that changed must show.
"""

from __future__ import annotations

from typing import List, Tuple

import pytest

from robot.errors import HardwareError
from robot.geometry import DifferentialDrive, WheelSpeeds
from robot.hat.bus import channel_bytes
from robot.hat.config import HatConfig, MotorConfig
from robot.hat.stepping import StepPlanner
from sim_pybullet.virtual.clock import VirtualClock
from sim_pybullet.virtual.hat import VirtualHat
from sim_pybullet.virtual.i2c import BusFault
from tests.robot.hat.rig import Rig, Transaction, WatchedBus, duty, make_rig, speeds

READS = [(0x00, 1), (0x01, 1), (0xFE, 1)]


class DatedBus(WatchedBus):
    """Notes when each transaction begins, and takes no time for it."""

    def __init__(self, clock: VirtualClock) -> None:
        super().__init__()
        self.dated: List[Tuple[float, Transaction]] = []
        self._dates = clock

    def _begin(self, transaction: Transaction) -> None:
        self.dated.append((self._dates.now(), transaction))
        super()._begin(transaction)


def dated_rig() -> Tuple[Rig, DatedBus]:
    rig = make_rig()
    bus = DatedBus(rig.clock)
    hat = VirtualHat(bus, rig.clock)
    rig.driver._hat._bus = bus
    return Rig(rig.clock, bus, hat, rig.driver), bus


def writes(bus: DatedBus) -> List[Tuple[float, bytes]]:
    return [(time_s, t.data) for time_s, t in bus.dated if not t.read_count]


def test_the_defaults_are_the_documented_ones() -> None:
    assert HatConfig() == HatConfig(
        bus=1,
        socket="",
        bus_hz=100_000,
        addresses=(0x6F, 0x60),
        left=MotorConfig("M1M2", False, 1.0),
        right=MotorConfig("M3M4", True, 1.0),
        drive=DifferentialDrive(0.102, 0.0325),
        steps_per_rev=48.0,
        microsteps=2,
        run_duty=1.0,
        hold_duty=0.3,
        acceleration_mps2=0.8,
        start_stop_mps=0.05,
        max_speed_mps=0.4,
        hold_after_s=0.25,
        release_after_s=60.0,
        command_timeout_s=0.5,
    )


def test_opening_writes_what_the_data_sheet_asks_for_in_this_order() -> None:
    rig, bus = dated_rig()
    rig.driver.open()
    sent = [t.data for _, t in bus.dated if not t.read_count]
    assert sent == [
        b"\xfd\x10",  # ALL_LED_OFF_H: full off
        b"\x00\x30",  # MODE1: asleep, auto-increment
        b"\xfe\x03",  # PRE_SCALE: 1526 Hz, which can be written asleep only
        b"\x00\x20",  # MODE1: awake
        b"\x01\x04",  # MODE2: totem pole, changes on STOP
    ]
    asked = [(t.data[0], t.read_count) for _, t in bus.dated if t.read_count]
    assert asked == READS * 2, "who is there, and whether it took all that"
    awake_s = next(time_s for time_s, t in bus.dated if t.data == b"\x00\x20")
    assert bus.dated[-3][0] - awake_s == pytest.approx(500e-6), "the oscillator starts"


@pytest.mark.parametrize(
    ("level", "registers"),
    [
        (0.0, "00000010"),
        (0.0001, "00000010"),
        (1 / 4096, "00000100"),
        (0.3, "0000cd04"),
        (0.5, "00000008"),
        (4095 / 4096, "0000ff0f"),
        (0.9999, "00100000"),
        (1.0, "00100000"),
    ],
)
def test_registers_of_a_level(level: float, registers: str) -> None:
    assert channel_bytes(level).hex() == registers


def test_the_wheels_wake_half_a_step_beside_and_step_after_55_hundredths() -> None:
    rig, bus = dated_rig()
    with rig.driver:
        bus.dated.clear()
        began_s = rig.clock.now()
        rig.drive(0.05, 0.05, 0.7)
        changes = [(round(t - began_s, 3), data) for t, data in writes(bus)]
        beside, straight = (data for _, data in changes[:2])
        on, off = "00100000", "00000010"
        # Channels 2 to 13: PWMA, AIN2, AIN1, BIN1, BIN2, PWMB of both; half a step on is A and B.
        assert beside.hex() == "0e" + 2 * (on + on + off + on + off + on)
        coils = on + off + off + off
        assert straight.hex() == "12" + coils + 2 * on + coils, "PWMB and PWMA lie between"
        assert [when_s for when_s, _ in changes[:2]] == [0.0, 0.25]
        assert changes[2][0] == pytest.approx(0.55 + 0.5 * 0.0021 / 0.05, abs=0.025)


def test_a_third_attempt_switches_off_where_two_failed() -> None:
    rig = make_rig()
    with rig.driver:
        rig.drive(0.2, 0.2, 1.0)
        rig.bus.inject(BusFault.NACK, count=3)  # a step or a look, and two attempts
        with pytest.raises(HardwareError, match="not acknowledged"):
            rig.drive(0.2, 0.2, 0.2)
        assert not rig.hat.chip.outputs.any_high
        rig.driver.open()
        rig.drive(0.2, 0.2, 1.0)
        rig.bus.log.clear()
        rig.bus.inject(BusFault.NACK, count=4)
        with pytest.raises(HardwareError, match="cut the motor supply"):
            rig.drive(0.2, 0.2, 0.2)
        assert [t.data for t in rig.bus.log].count(b"\xfd\x10") == 3
        rig.driver.open()


def test_an_exit_in_the_middle_of_a_step_switches_off(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def interrupted(_: object) -> None:
        raise SystemExit

    rig = make_rig()
    with rig.driver:
        rig.drive(0.2, 0.2, 1.0)
        monkeypatch.setattr(rig.driver._hat, "move", interrupted)
        with pytest.raises(SystemExit):
            rig.drive(0.2, 0.2, 0.2)
        assert not rig.hat.chip.outputs.any_high
        with pytest.raises(HardwareError, match="the motors are off since"):
            rig.driver.set_wheels(WheelSpeeds(0.2, 0.2))


def test_a_rolling_robot_keeps_its_coils_for_three_tenths_of_a_second() -> None:
    rig, bus = dated_rig()
    with rig.driver:
        rig.drive(0.2, 0.2, 1.5)
        bus.dated.clear()
        began_s = rig.clock.now()
        rig.driver.release()
        rig.wait(1.0)
        sent = writes(bus)
        assert sent[-1][1] == b"\xfd\x10"
        assert sent[-1][0] - began_s == pytest.approx(0.3)
        steps_s = [t - began_s for t, data in sent[:-1]]
        assert max(steps_s) < 0.15, "and brakes within half of that"


def test_who_is_told_to_stand_while_it_is_released_is_released_all_the_same() -> None:
    rig = make_rig()
    with rig.driver:
        rig.drive(0.2, 0.2, 1.5)
        rig.driver.release()
        rig.drive(0.0, 0.0, 0.35)
        assert not rig.hat.chip.outputs.any_high


def test_who_has_just_stopped_is_held_before_its_coils_go_off() -> None:
    """Its last step is made, and it may roll yet."""
    rig = make_rig()
    with rig.driver:
        rig.drive(0.2, 0.2, 1.5)
        rig.driver.stop()
        rig.wait(0.16)
        assert rig.driver.planner.deadline_s is None
        rig.driver.release()
        rig.wait(0.25)
        assert rig.hat.chip.outputs.any_high
        rig.wait(0.06)
        assert not rig.hat.chip.outputs.any_high


def test_who_is_released_again_and_again_is_not_held_for_longer() -> None:
    rig = make_rig()
    with rig.driver:
        rig.drive(0.2, 0.2, 1.5)
        for _ in range(6):
            rig.driver.release()
            rig.wait(0.052)
        assert not rig.hat.chip.outputs.any_high


def test_coils_have_the_whole_duty_until_the_last_step_of_a_ramp() -> None:
    rig = make_rig(HatConfig(hold_after_s=0.01))  # its steps are 7 to 40 ms apart
    with rig.driver:
        rig.drive(0.3, 0.3, 2.0)
        rig.driver.set_wheels(WheelSpeeds(0.0, 0.0))
        while rig.driver.planner.deadline_s is not None:
            assert duty(rig.hat.chip.outputs, 8) == 1.0
            rig.wait(0.002)
        rig.wait(0.05)
        assert duty(rig.hat.chip.outputs, 8) == pytest.approx(0.3, abs=1e-3)


def test_coils_drop_to_hold_after_a_quarter_second_and_go_off_after_a_minute() -> None:
    rig, bus = dated_rig()
    with rig.driver:
        rig.drive(0.04, 0.04, 1.0)
        rig.drive(0.0, 0.0, 0.1)
        stepped_s = writes(bus)[-1][0]
        rig.wait(70.0)
        (held_s, held), (off_s, off) = writes(bus)[-2:]
        assert (held_s - stepped_s, off_s - stepped_s) == pytest.approx((0.25, 60.0))
        assert held[:5].hex() == "0e0000cd04", "three tenths on PWMA"
        assert off == b"\xfd\x10"


def test_a_command_counts_for_half_a_second() -> None:
    rig, bus = dated_rig()
    with rig.driver:
        rig.drive(0.05, 0.05, 1.0)
        rig.driver.set_wheels(WheelSpeeds(0.05, 0.05))
        told_s = rig.clock.now()
        bus.dated.clear()
        rig.wait(1.0)
        steps_s = [t - told_s for t, data in writes(bus) if data[0] == 0x12]
        assert 0.5 - 2 * 0.0425 < max(steps_s) <= 0.5


@pytest.mark.parametrize(("pause_s", "goes_on"), [(0.19, True), (0.25, False)])
def test_after_a_pause_of_a_fifth_of_a_second_the_wheels_stand(
    pause_s: float, goes_on: bool
) -> None:
    rig = make_rig()
    with rig.driver:
        rig.drive(0.3, 0.3, 2.0)
        due_s = rig.driver.planner.deadline_s
        assert due_s is not None
        rig.clock.advance_to(due_s + pause_s)
        before = rig.driver.planner.counts
        rig.wait(0.2)
        assert (rig.driver.planner.counts != before) == goes_on


def test_ramps_take_their_time() -> None:
    """From 0.05 to 0.4 m/s at 0.8 m/s^2, and braked from there within 0.15 s."""
    planner = StepPlanner(HatConfig(), 0.0)
    planner.set_speeds(0.0, WheelSpeeds(0.4, -0.4))
    assert speeds(planner, 0.0) == pytest.approx((0.05, -0.05))
    assert speeds(planner, 0.2) == pytest.approx((0.21, -0.21))
    assert speeds(planner, 0.43) == pytest.approx((0.394, -0.394))
    assert speeds(planner, 0.4375) == pytest.approx((0.4, -0.4))
    planner.brake(1.0)
    assert speeds(planner, 1.06) == pytest.approx((0.24, -0.24))
    assert speeds(planner, 1.15) == (0.0, 0.0)


@pytest.mark.parametrize(
    ("late_steps", "delayed_steps", "stalls"), [(0.45, 0.0, 0), (0.9, 0.4, 0), (1.1, None, 2)]
)
def test_half_a_step_of_lateness_is_caught_up_and_a_whole_one_is_a_stall(
    late_steps: float, delayed_steps: float, stalls: int
) -> None:
    planner = StepPlanner(HatConfig(), 0.0)
    planner.set_speeds(0.0, WheelSpeeds(0.3, 0.3))
    while (planner.deadline_s or 0.0) < 2.0:
        planner.advance(planner.deadline_s or 0.0)
    due_s = planner.deadline_s
    assert due_s is not None
    full_step_s = 0.00425424 / 0.3
    planner.advance(due_s + late_steps * full_step_s)
    assert planner.stalls == stalls
    if delayed_steps is not None:
        expected_s = due_s + (0.5 + delayed_steps) * full_step_s
        assert planner.deadline_s == pytest.approx(expected_s, abs=1e-5)
