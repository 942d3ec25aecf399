import contextlib
import math
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from robot.contract import ACTION_WHEELS
from robot.errors import ContractError, HardwareError
from robot.geometry import DifferentialDrive, Pose, WheelSpeeds
from robot.hat.config import HatConfig, MotorConfig
from robot.hat.driver import HELD_S, WAKE_S
from robot.hat.stepping import BRAKE_S
from sim_pybullet.virtual.i2c import BusFault
from tests.robot.hat.rig import ALL_OFF, Rig, duty, full_step_m, make_rig, speeds
from tests.thorough import count

START_S = WAKE_S + 0.01


# AIN2, AIN1, BIN1, BIN2 of each half step, as channels 9 to 12 and 3 to 6 must show them.
RING = ["1000", "1010", "0010", "0110", "0100", "0101", "0001", "1001"]


def ring_position(rig: Rig, first_channel: int) -> int:
    """Which half step the chip's outputs show; fails when they show none."""
    duties = [duty(rig.hat.chip.outputs, first_channel + i) for i in range(4)]
    return RING.index("".join(f"{duty:g}" for duty in duties))


@pytest.mark.parametrize("wheels", [(0.3, 0.3), (-0.2, 0.2), (0.1, 0.0), (-0.3, -0.15)])
def test_wheels_turn_the_way_and_as_far_as_the_odometry_says(wheels: tuple) -> None:
    rig = make_rig()
    with rig.driver:
        rig.drive(wheels[0], wheels[1], 2.0)
        rig.come_to_rest()
        counts = rig.driver.planner.counts
        step_m = rig.driver.config.step_m
        assert rig.rolled_m == pytest.approx([n * step_m for n in counts], abs=0.6 * step_m)
        assert [math.copysign(1, n) for n in counts if n] == [
            math.copysign(1, w) for w in wheels if w
        ]
        assert rig.hat.lost_steps == (0, 0)


def test_straight_driving_is_one_write_for_a_step_of_both_motors() -> None:
    rig = make_rig()
    with rig.driver:
        rig.drive(0.2, 0.2, 1.0)
        rig.bus.log.clear()
        before = rig.driver.planner.counts
        rig.drive(0.2, 0.2, 1.0)
        steps = rig.driver.planner.counts.left - before.left
        writes = [t for t in rig.bus.log if not t.read_count]
        assert steps > 90
        assert len(writes) == steps
        assert {len(t.data) for t in writes} == {41}
        assert {t.data[0] for t in writes} == {0x12}


def test_between_half_steps_the_duties_go_along_in_the_same_write() -> None:
    rig = make_rig(HatConfig(microsteps=8, bus_hz=1_000_000, max_speed_mps=0.1))
    with rig.driver:
        rig.drive(0.05, 0.05, 1.0)
        rig.bus.log.clear()
        before = rig.driver.planner.counts
        rig.drive(0.05, 0.05, 1.0)
        steps = rig.driver.planner.counts.left - before.left
        writes = [t for t in rig.bus.log if not t.read_count]
        assert steps > 80
        assert len(writes) == steps
        assert {(t.data[0], len(t.data)) for t in writes} == {(0x0E, 49)}


def test_coils_only_ever_move_one_place_around_the_ring() -> None:
    rig, rng = make_rig(), np.random.default_rng(3)
    seen = []
    drive_coils = rig.hat.chip._after_change

    def watch() -> None:
        drive_coils()
        if rig.driver.energised and rig.hat.chip.outputs.any_high:
            seen.append([ring_position(rig, first) for first in (9, 3)])

    with rig.driver:
        rig.drive(0.1, 0.1, START_S)  # finds the rotors by a jump
        rig.hat.chip._after_change = watch
        for _ in range(12):
            rig.drive(*rng.uniform(-0.4, 0.4, 2), 0.3)
    assert len(seen) > 200
    for before, after in zip(seen, seen[1:]):
        assert all((b - a + 1) % 8 <= 2 for a, b in zip(before, after))


@pytest.mark.parametrize("seed", range(count(2, 6)))
def test_no_step_is_lost_on_random_speed_profiles(seed: int) -> None:
    rig, rng = make_rig(), np.random.default_rng(seed)
    limit = rig.driver.config.max_speed_mps
    with rig.driver:
        for _ in range(20):
            wheels = [
                rng.uniform(-limit, limit, 2),
                rng.choice([-limit, 0.0, limit], 2),
                ACTION_WHEELS[rng.integers(5)],
            ][rng.integers(3)]
            rig.drive(*wheels, rng.uniform(0.05, 1.0))
            assert rig.hat.lost_steps == (0, 0)
        rig.come_to_rest()
        expected = [n * rig.driver.config.step_m for n in rig.driver.planner.counts]
        assert rig.rolled_m == pytest.approx(expected, abs=0.6 * rig.driver.config.step_m)


def test_no_step_is_lost_when_the_host_wakes_late() -> None:
    """Lateness as measured on a busy machine: 0.1 ms in the middle, 5 ms at worst."""
    rig, rng, wheels = make_rig(), np.random.default_rng(7), ACTION_WHEELS[2]
    with rig.driver:
        for _ in range(300):
            if rng.random() < 0.3:
                wheels = ACTION_WHEELS[rng.integers(5)]
            end_s = rig.clock.now() + 0.1
            deadline_s = rig.driver.set_wheels(wheels)
            while deadline_s is not None and deadline_s < end_s:
                late_s = rng.exponential(1e-4) + (rng.random() < 0.05) * rng.uniform(0.0, 5e-3)
                rig.clock.advance_to(deadline_s + late_s)
                deadline_s = rig.driver.pump(rig.clock.now())
            rig.clock.advance_to(end_s)
            assert rig.hat.lost_steps == (0, 0)
        assert rig.driver.planner.stalls == 0
        assert rig.driver.pose != Pose(0.0, 0.0, 0.0)


def test_a_long_stall_goes_on_slowly_and_the_rotors_follow_again() -> None:
    rig = make_rig()
    with rig.driver:
        rig.drive(0.2, 0.2, 2.0)
        rig.clock.sleep(0.4)
        slipped = rig.hat.lost_steps
        rig.drive(0.2, 0.2, 2.0)
        assert rig.driver.planner.stalls > 0
        assert speeds(rig.driver.planner, rig.clock.now()) == pytest.approx((0.2, 0.2))
        assert rig.hat.lost_steps == slipped


@pytest.mark.parametrize("then", ["pump", "stop", "release", "set_wheels"])
def test_after_a_pause_of_the_process_no_missed_step_is_made_up(then: str) -> None:
    rig = make_rig()
    with rig.driver:
        rig.drive(0.3, 0.3, 2.0)
        before_m = rig.driver.pose.x_m
        rig.clock.sleep(2.0)  # SIGSTOP, SIGCONT
        if then == "pump":
            rig.driver.pump(rig.clock.now())
        elif then == "set_wheels":
            rig.driver.set_wheels(WheelSpeeds(0.0, 0.0))
        else:
            getattr(rig.driver, then)()
        rig.wait(1.0)
        assert rig.driver.pose.x_m == before_m
        rig.come_to_rest()
        rig.drive(0.3, 0.3, 1.0)
        assert rig.driver.pose.x_m - before_m < 0.3 + 0.01


def test_what_is_commanded_after_a_pause_counts() -> None:
    rig = make_rig()
    with rig.driver:
        rig.drive(0.1, 0.1, 1.0)
        before_m = rig.driver.pose.x_m
        rig.clock.sleep(2.0)
        rig.driver.set_wheels(WheelSpeeds(0.1, 0.1))
        rig.wait(0.4)
        assert rig.driver.pose.x_m > before_m + 0.02


def test_the_rotor_does_lose_steps_without_ramps() -> None:
    rig = make_rig(HatConfig(start_stop_mps=0.4, acceleration_mps2=50.0))
    with rig.driver:
        rig.drive(0.0, 0.01, START_S)
        rig.drive(0.4, 0.4, 1.0)
        assert any(rig.hat.lost_steps)


@settings(max_examples=25, deadline=None)
@given(st.lists(st.floats(-180.0, 180.0), min_size=2, max_size=2))
@example([180.0, 177.0])  # opposite to the coils of the ring's beginning: pulled to neither side
@example([0.0, 3.0])  # and how the field of a mirrored motor is met
@example([-90.0, 90.0])
def test_no_step_is_lost_wherever_the_rotors_rested(electrical_deg: list) -> None:
    rig = make_rig()
    for rotor, angle_deg in zip(rig.hat.rotors, electrical_deg):
        rotor.angle_rad = math.radians(angle_deg) / rotor.model.electrical_turns
    with rig.driver:
        rig.drive(0.4, 0.4, WAKE_S)
        before, counts = rig.rolled_m, rig.driver.planner.counts
        rig.drive(0.4, 0.4, 1.5)
        rig.come_to_rest()
        rolled_m = np.subtract(rig.rolled_m, before)
        due_m = np.subtract(rig.driver.planner.counts, counts) * rig.driver.config.step_m
        assert rolled_m == pytest.approx(due_m, abs=full_step_m(rig.driver.config))


def test_a_square_returns_home() -> None:
    quarter_steps = 38  # of each wheel for 90 degrees, exactly, on this axle
    baseline_m = 4 * quarter_steps * HatConfig().step_m / math.pi
    rig = make_rig(HatConfig(drive=DifferentialDrive(baseline_m=baseline_m)))
    truth = Pose(0.0, 0.0, 0.0)  # from the wheels' angles instead of the steps

    def drive(left_mps: float, right_mps: float, duration_s: float) -> None:
        nonlocal truth
        for _ in range(round(duration_s / 0.02)):
            before = rig.rolled_m
            rig.drive(left_mps, right_mps, 0.02)
            left_m, right_m = np.subtract(rig.rolled_m, before)
            truth = truth.moved((left_m + right_m) / 2, (right_m - left_m) / baseline_m)

    with rig.driver:
        drive(0.0, 1e-6, START_S)
        for _ in range(4):
            drive(0.2, 0.2, 1.5)
            drive(0.0, 0.0, 1.0)
            start = rig.driver.planner.counts.right
            while rig.driver.planner.counts.right < start + quarter_steps:
                drive(-0.04, 0.04, 0.02)
            drive(0.0, 0.0, 1.0)
        pose = rig.driver.pose
    assert pose == pytest.approx(truth, abs=0.01)
    turn_of_a_step_rad = rig.driver.config.step_m / baseline_m
    assert abs(pose.heading_rad) < 4 * turn_of_a_step_rad
    assert math.hypot(pose.x_m, pose.y_m) < 0.03


def test_standing_coils_drop_to_hold_and_then_let_go() -> None:
    rig = make_rig(HatConfig(release_after_s=5.0))
    with rig.driver:
        rig.drive(0.1, 0.1, 1.0)
        rig.come_to_rest()
        duties = [duty(rig.hat.chip.outputs, channel) for channel in (2, 7, 8, 13)]
        assert duties == pytest.approx([0.3] * 4, abs=1e-3)
        currents = [abs(c.current) for rotor in rig.hat.rotors for c in rotor.drives if c.current]
        assert currents == pytest.approx([0.3] * len(currents), abs=1e-3)
        assert len(currents) >= 2
        rig.wait(5.0)
        assert not rig.driver.energised
        assert rig.last.data == ALL_OFF
        assert not rig.hat.chip.outputs.any_high
        rig.drive(0.1, 0.1, 1.0)
        assert rig.driver.energised


def test_an_old_command_stops_counting() -> None:
    rig = make_rig()
    with rig.driver:
        rig.drive(0.3, 0.3, 2.0)
        rig.wait(rig.driver.config.command_timeout_s + 1.0)
        assert speeds(rig.driver.planner, rig.clock.now()) == (0.0, 0.0)
        assert rig.hat.lost_steps == (0, 0)


@pytest.mark.parametrize(("speed_mps", "steps"), [(0.05, 1), (0.4, 17)])
def test_an_abandoned_robot_stops_by_itself(speed_mps: float, steps: int) -> None:
    """Nobody writes any more: the fields stand, and momentum carries the rotors at most so far."""
    rig = make_rig()
    rig.driver.open()
    rig.drive(speed_mps, speed_mps, 2.0)
    before_m = np.array(rig.rolled_m)
    rig.clock.sleep(60.0)
    assert rig.driver.energised
    a_step_m = full_step_m(rig.driver.config)
    assert np.abs(np.array(rig.rolled_m) - before_m).max() <= steps * a_step_m


def test_stop_holds_release_lets_go_and_both_can_be_repeated() -> None:
    rig = make_rig()
    with rig.driver:
        rig.drive(0.05, 0.05, 1.0)
        for _ in range(2):
            rig.driver.stop()
            rig.wait(0.1)
            assert rig.driver.energised
        assert rig.hat.lost_steps == (0, 0)
        rig.wait(HELD_S)
        for _ in range(2):
            rig.driver.release()
            assert rig.last.data == ALL_OFF
            assert not rig.hat.chip.outputs.any_high
        counts = rig.driver.planner.counts
        rig.wait(1.0)
        assert rig.driver.planner.counts == counts


def test_gains_make_wheels_of_two_sizes_roll_alike() -> None:
    rig = make_rig(
        HatConfig(left=MotorConfig("M1M2", gain=0.96), right=MotorConfig("M3M4", True, 1.04))
    )
    with rig.driver:
        rig.drive(0.3, 0.3, 3.0)
        assert speeds(rig.driver.planner, rig.clock.now()) == pytest.approx((0.3, 0.3))
        rig.come_to_rest()
        rolled_m = np.multiply(rig.rolled_m, (0.96, 1.04))  # by the radii that the gains tell of
        assert rolled_m == pytest.approx([rig.driver.pose.x_m] * 2, abs=0.005)
        assert abs(rig.driver.pose.heading_rad) < 0.05
        assert rig.hat.lost_steps == (0, 0)


@pytest.mark.parametrize("speed_mps", [0.1, 0.3, 0.4])
def test_a_released_robot_brakes_before_its_coils_go_off(speed_mps: float) -> None:
    rig = make_rig()
    with rig.driver:
        rig.drive(speed_mps, speed_mps, 2.0)
        before_m = rig.rolled_m
        rig.driver.release()
        rig.wait(BRAKE_S + 0.1)
        assert rig.driver.energised
        assert rig.hat.lost_steps == (0, 0)
        for _ in range(20):
            rig.driver.release()  # asking again does not put it off
            rig.wait(0.01)
        assert not rig.hat.chip.outputs.any_high
        rig.wait(2.0)
        braked_m = max(np.subtract(rig.rolled_m, before_m))
        assert braked_m < 0.035
        assert rig.rolled_m == pytest.approx([rig.driver.pose.x_m] * 2, abs=0.01)
    assert braked_m < 0.5 * coasted_m(speed_mps)


def coasted_m(speed_mps: float) -> float:
    """How far a robot rolls whose coils go off at once, as after a fault of the bus."""
    rig = make_rig()
    rig.driver.open()
    rig.drive(speed_mps, speed_mps, 2.0)
    before_m = rig.rolled_m
    rig.driver._hat.release()
    rig.clock.sleep(3.0)
    return float(max(np.subtract(rig.rolled_m, before_m)))


def test_a_robot_told_to_drive_while_it_brakes_keeps_its_coils() -> None:
    rig = make_rig()
    with rig.driver:
        rig.drive(0.2, 0.2, 1.0)
        rig.driver.release()
        for _ in range(20):
            rig.drive(0.1, 0.1, 0.1)
            assert rig.hat.chip.outputs.any_high
        assert speeds(rig.driver.planner, rig.clock.now()) == pytest.approx((0.1, 0.1))
        assert rig.hat.lost_steps == (0, 0)


@pytest.mark.parametrize(("nacks", "off"), [(3, True), (4, False)])
def test_all_off_is_tried_three_times_after_a_fault(nacks: int, off: bool) -> None:
    """The first NACK is the fault, the others meet the attempts to switch off."""
    rig = make_rig()
    with contextlib.suppress(HardwareError), rig.driver:
        rig.drive(0.3, 0.3, 1.0)
        rig.bus.inject(BusFault.NACK, count=nacks)
        with pytest.raises(HardwareError) as told:
            rig.drive(0.3, 0.3, 0.2)
        assert ("cut the motor supply" in str(told.value)) is not off
        assert rig.hat.chip.outputs.any_high is not off


@pytest.mark.parametrize("fault", list(BusFault))
def test_a_bus_fault_is_told_and_leaves_every_output_off(fault: BusFault) -> None:
    rig = make_rig()
    with rig.driver:
        rig.drive(0.2, 0.2, 1.0)
        rig.bus.inject(fault, count=2)
        with pytest.raises(HardwareError, match="virtual I2C bus: PCA9685 at 0x6F"):
            rig.drive(0.2, 0.2, 1.0)
        assert not rig.hat.chip.outputs.any_high
        with pytest.raises(HardwareError, match="the motors are off since"):
            rig.driver.set_wheels(WheelSpeeds(0.1, 0.1))
        rig.driver.open()
        rig.drive(0.1, 0.1, 1.0)
        assert rig.driver.energised
    assert rig.last.data == ALL_OFF


@pytest.mark.parametrize("after", range(24))
def test_a_write_cut_off_at_any_step_ends_with_all_off(after: int) -> None:
    """Half of a write can leave a channel between full on and full off."""
    rig = make_rig()
    with contextlib.suppress(HardwareError), rig.driver:
        rig.drive(0.2, 0.3, 1.0)
        rig.bus.inject(BusFault.PARTIAL, after=after)
        with pytest.raises(HardwareError, match="virtual I2C bus: PCA9685 at 0x6F"):
            rig.drive(0.2, 0.3, 1.0)
        assert not rig.hat.chip.outputs.any_high
        rig.driver.open()
        rig.drive(0.1, 0.1, 1.0)
        assert rig.driver.energised


def test_a_robot_that_stands_is_released_at_the_third_attempt() -> None:
    rig = make_rig()
    with rig.driver:
        rig.drive(0.1, 0.1, 1.0)
        rig.come_to_rest()
        rig.bus.inject(BusFault.NACK, count=2)
        rig.driver.release()
        assert not rig.hat.chip.outputs.any_high


def test_a_dead_bus_is_told_as_such() -> None:
    rig = make_rig()
    rig.driver.open()
    rig.drive(0.2, 0.2, 1.0)
    rig.bus.inject(BusFault.STUCK, count=1000)
    with pytest.raises(HardwareError, match="cut the motor supply"):
        rig.drive(0.2, 0.2, 1.0)


def test_an_exception_in_the_block_ends_with_all_off() -> None:
    rig = make_rig()

    def crash() -> None:
        with rig.driver:
            rig.drive(0.2, 0.2, 1.0)
            raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        crash()
    assert sum(rig.rolled_m) < 2 * 0.2 * (1.0 - WAKE_S) + 0.03
    left_at_m = rig.rolled_m
    rig.clock.sleep(10.0)
    assert rig.rolled_m == pytest.approx(left_at_m, abs=0.01)
    assert rig.last.data == ALL_OFF
    assert not rig.hat.chip.outputs.any_high


def test_an_interrupt_while_it_brakes_ends_with_all_off() -> None:
    rig = make_rig()

    def interrupted(_: float) -> None:
        raise KeyboardInterrupt

    with contextlib.suppress(KeyboardInterrupt), rig.driver:
        rig.drive(0.3, 0.3, 1.0)
        rig.driver._clock = SimpleNamespace(now=rig.clock.now, sleep=interrupted)
    assert rig.last.data == ALL_OFF
    assert not rig.hat.chip.outputs.any_high


def test_a_wheel_that_stands_beside_one_that_turns_has_the_whole_duty() -> None:
    rig = make_rig()
    with rig.driver:
        rig.drive(0.1, 0.1, 1.0)
        rig.come_to_rest()
        rig.drive(0.1, 0.0, 0.5)
        assert [duty(rig.hat.chip.outputs, channel) for channel in (2, 7, 8, 13)] == [1.0] * 4


def test_a_chip_that_lost_its_supply_is_noticed() -> None:
    rig = make_rig()
    with rig.driver:
        rig.drive(0.2, 0.2, 1.0)
        rig.hat.chip.power_cycle()
        with pytest.raises(HardwareError, match="the chip was reset"):
            rig.drive(0.2, 0.2, 2.0)


@pytest.mark.parametrize("wheels", [(math.nan, 0.0), (0.0, math.inf), (0.5, 0.0), (0.0, -0.5)])
def test_impossible_speeds_are_refused_and_change_nothing(wheels: tuple) -> None:
    rig = make_rig()
    with rig.driver:
        rig.drive(0.1, 0.1, 1.0)
        with pytest.raises(ContractError, match=r"expected -0.4 to 0.4 m/s"):
            rig.driver.set_wheels(WheelSpeeds(*wheels))
        rig.wait(0.05)
        assert speeds(rig.driver.planner, rig.clock.now()) == pytest.approx((0.1, 0.1))


def test_full_and_quarter_steps_turn_the_wheels_as_far() -> None:
    for microsteps in (1, 4, 16):
        rig = make_rig(HatConfig(microsteps=microsteps, bus_hz=1_000_000, max_speed_mps=0.1))
        with rig.driver:
            rig.drive(0.1, 0.1, 3.0)
            rig.come_to_rest()
            expected_m = 0.1 * (3.0 - WAKE_S)
            assert rig.driver.pose.x_m == pytest.approx(expected_m, abs=0.02)
            assert rig.rolled_m == pytest.approx([rig.driver.pose.x_m] * 2, abs=0.003)


@pytest.mark.parametrize("error", [KeyboardInterrupt, ZeroDivisionError, MemoryError])
def test_whatever_breaks_off_a_step_switches_off(error: type) -> None:
    rig = make_rig()
    rig.driver.open()
    rig.drive(0.2, 0.2, 1.0)

    def broken(_: object) -> None:
        raise error("no step")

    rig.driver._hat.move = broken  # type: ignore[method-assign]
    with pytest.raises(error):
        rig.drive(0.2, 0.2, 1.0)
    assert not rig.hat.chip.outputs.any_high
    with pytest.raises(HardwareError, match="the motors are off since: no step"):
        rig.driver.pump(rig.clock.now())


@pytest.mark.parametrize("after_s", [0.1, 0.4, 2.0])
def test_a_robot_whose_motors_are_mended_stands_until_it_is_told_to_drive(after_s: float) -> None:
    """In the first quarter of a second the coils were to change; then it drove."""
    rig = make_rig()
    with rig.driver:
        rig.drive(0.2, 0.2, after_s)
        with pytest.raises(HardwareError):
            rig.driver.fail(HardwareError("the bus broke"))
        rig.driver.mend()
        counts = rig.driver.planner.counts
        for _ in range(100):
            rig.clock.sleep(0.01)
            assert rig.driver.pump(rig.clock.now()) is None
        assert rig.driver.planner.counts == counts
        assert not rig.hat.chip.outputs.any_high


def test_a_rotor_is_found_with_all_of_the_current() -> None:
    rig = make_rig()
    with rig.driver:
        for _ in range(int(WAKE_S / 0.01) - 1):
            rig.drive(0.2, 0.2, 0.01)
            duties = [duty(rig.hat.chip.outputs, channel) for channel in (2, 7, 8, 13)]
            assert max(duties) == 1.0
            assert min(duties) > 0.9
