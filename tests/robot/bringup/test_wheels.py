"""The figures of the wheels, from robots that are known."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from robot.bringup.roller import Roller
from robot.bringup.wheels import GUIDES, baseline_from_turns, trim_from_drive
from robot.cli.calibrate import edit_yaml
from robot.config import RobotConfig
from robot.errors import ConfigError, HardwareError
from robot.geometry import DifferentialDrive, Pose, WheelSpeeds
from robot.hat.config import HatConfig, MotorConfig
from robot.typed_config import load_yaml
from tests.robot.bringup.bench import BenchMotors, Spectator


def calibrated(what: str, hat: HatConfig, person: Spectator, path: Path) -> HatConfig:
    """The motor settings after one guided measurement, in which the robot drove slowly."""
    set_wheels, speeds_mps = person.motors.set_wheels, [0.0]

    def watched(wheels: WheelSpeeds) -> None:
        speeds_mps.extend(map(abs, wheels))
        set_wheels(wheels)

    person.motors.set_wheels = watched  # type: ignore[method-assign]
    drive = f"drive: {{baseline_m: {hat.drive.baseline_m}, wheel_radius_m: 0.0325}}"
    path.write_text(f"model: m.onnx\nhat:\n  steps_per_rev: {hat.steps_per_rev}\n  {drive}\n")
    with person.motors as motors:
        values = GUIDES[what](Roller(motors, hat, motors), person)
    assert max(speeds_mps) == pytest.approx(0.08)
    person.told += edit_yaml(path, values)
    return load_yaml(RobotConfig, path).hat


def test_wheels_of_two_sizes_are_found_and_drive_straight_afterwards(tmp_path: Path) -> None:
    radii_m, believed = (0.0318, 0.0327), HatConfig()
    person = Spectator(BenchMotors(believed), radii_m)
    found = calibrated("trim", believed, person, tmp_path / "robot.yaml")
    gains = (found.left.gain, found.right.gain)
    assert gains[1] / gains[0] == pytest.approx(radii_m[1] / radii_m[0], rel=0.002)
    found_radii_m = [gain * found.drive.wheel_radius_m for gain in gains]
    assert found_radii_m == pytest.approx(radii_m, rel=0.003)
    again = Spectator(BenchMotors(found), radii_m)
    second = calibrated("trim", found, again, tmp_path / "again.yaml")
    assert second.left.gain == pytest.approx(found.left.gain, abs=0.002)


def test_the_distance_of_the_wheels_is_found(tmp_path: Path) -> None:
    believed = HatConfig(drive=DifferentialDrive(baseline_m=0.098))
    person = Spectator(BenchMotors(believed), baseline_m=0.105)
    found = calibrated("baseline", believed, person, tmp_path / "robot.yaml")
    assert person.told[-1].startswith("hat.drive.baseline_m: 0.098 -> 0.10")
    assert not person.motors.coils_on
    assert found.drive.baseline_m == pytest.approx(0.105, rel=0.003)


@given(
    left=st.floats(0.96, 1.04),
    right=st.floats(0.96, 1.04),
    gains=st.tuples(st.floats(0.98, 1.02), st.floats(0.98, 1.02)),
)
@settings(max_examples=50, deadline=None)
def test_a_trimmed_robot_believes_where_it_truly_drives(
    left: float, right: float, gains: tuple
) -> None:
    """The law behind trim: by the new figures, the same steps lead where the robot went."""
    hat = HatConfig()
    hat = replace(
        hat, left=replace(hat.left, gain=gains[0]), right=replace(hat.right, gain=gains[1])
    )
    steps = [1.5 / step_m for step_m in hat.wheel_steps_m]
    ways = [n * s * k for n, s, k in zip(steps, hat.wheel_steps_m, (left, right))]
    end = Pose(0.0, 0.0, 0.0).moved(0.5 * sum(ways), (ways[1] - ways[0]) / hat.drive.baseline_m)
    bend_rad = abs(ways[1] - ways[0]) / hat.drive.baseline_m
    if bend_rad > 1.0:  # beyond what a drive that should be straight may bend
        return
    values = trim_from_drive(hat, 1.5, end.x_m, end.y_m)
    radius_m = values[("hat", "drive", "wheel_radius_m")]
    for side, way_m, count in zip(("left", "right"), ways, steps):
        gain = values[("hat", side, "gain")]
        believed_m = count * 2.0 * math.pi * radius_m * gain / hat.steps_per_rev / hat.microsteps
        assert believed_m == pytest.approx(way_m, rel=3e-4)


def test_what_no_robot_can_be_is_refused_with_what_was_seen() -> None:
    hat = HatConfig()
    for ahead_m, left_m in ((0.5, 0.9), (0.5, -0.9), (-1.5, 0.0), (0.0, 0.0)):
        with pytest.raises(ConfigError, match=r"drag or slip"):
            trim_from_drive(hat, 1.5, ahead_m, left_m)
    with pytest.raises(ConfigError, match=r"wheel radius.*1\.000 m instead of 1\.500 m"):
        trim_from_drive(hat, 1.5, 1.0, 0.0)
    with pytest.raises(ConfigError, match=r"baseline.*1\.333.*-450° beyond"):
        baseline_from_turns(hat, 10.0 * math.pi, -2.5 * math.pi)
    with pytest.raises(ConfigError, match=r"baseline.*inf"):
        baseline_from_turns(hat, 10.0 * math.pi, -10.0 * math.pi)


def test_wheels_that_do_not_come_are_given_up_after_three_times_what_they_need() -> None:
    motors = BenchMotors(HatConfig())
    motors.dead = True
    with motors:
        began_s = motors.now()
        with pytest.raises(HardwareError, match="do the motors get their commands"):
            Roller(motors, HatConfig(), motors).roll(0.0, -0.16, 0.08)  # type: ignore[arg-type]
        assert 9.0 <= motors.now() - began_s <= 9.2  # 2 s at that speed, and 1 s more


@pytest.mark.parametrize(
    ("ways_m", "speed_mps"),
    [((0.1, 0.0), 0.08), ((0.0, -0.1), 0.08), ((-0.05, 0.1), 0.08), ((0.4, 0.4), 0.15)],
)
def test_each_wheel_goes_as_far_as_told_and_no_faster(ways_m: tuple, speed_mps: float) -> None:
    config = HatConfig(left=MotorConfig("M1M2", gain=0.92), right=MotorConfig("M3M4", True, 1.08))
    with BenchMotors(config) as motors:
        began_s = motors.now()
        went_m = Roller(motors, config, motors).roll(*ways_m, speed_mps)  # type: ignore[arg-type]
        assert motors.now() - began_s > max(map(abs, ways_m)) / speed_mps
        assert went_m == pytest.approx(ways_m, abs=2.0 * config.step_m)
        counts = motors.counts
        motors.sleep(1.0)
        assert motors.counts == counts, "it rests"
        rolled_m = np.multiply(motors.rig.rolled_m, (0.92, 1.08))  # of the radii by these gains
        assert rolled_m == pytest.approx(ways_m, abs=2.5 * config.step_m)


def test_wheels_rest_when_they_have_stood_for_four_tenths_of_a_second() -> None:
    with BenchMotors(HatConfig()) as motors:
        roller = Roller(motors, HatConfig(), motors)  # type: ignore[arg-type]
        began_s = motors.now()
        roller.come_to_rest()
        assert 0.4 <= motors.now() - began_s <= 0.5
        for _ in range(10):
            motors.set_wheels(WheelSpeeds(0.4, 0.4))  # from there the ramp takes half a second
            motors.sleep(0.1)
        roller.come_to_rest()
        counts = motors.counts
        motors.sleep(1.0)
        assert motors.counts == counts


@pytest.mark.parametrize("what", sorted(GUIDES))
def test_a_person_who_does_not_say_yes_moves_nothing(what: str) -> None:
    with BenchMotors(HatConfig()) as motors:
        person = Spectator(motors)
        person.agrees = lambda _: False  # type: ignore[method-assign]
        with pytest.raises(ConfigError, match="expected a yes"):
            GUIDES[what](Roller(motors, HatConfig(), motors), person)  # type: ignore[arg-type]
        motors.sleep(1.0)
        assert motors.counts == (0, 0)


def test_a_figure_that_the_bus_cannot_carry_is_not_written(tmp_path: Path) -> None:
    path = tmp_path / "robot.yaml"
    path.write_text("model: m.onnx\n")
    with pytest.raises(ConfigError, match="updates per second"):
        edit_yaml(path, {("hat", "steps_per_rev"): 200.0})
    assert path.read_text() == "model: m.onnx\n"
