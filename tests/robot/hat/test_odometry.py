import math
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from robot.geometry import DifferentialDrive, Pose
from robot.hat.config import HatConfig, MotorConfig
from robot.hat.stepping import Steps, pose_after

DRIVE = DifferentialDrive(wheel_radius_m=0.002 * 96 / (2.0 * math.pi))
CONFIG = HatConfig(drive=DRIVE, steps_per_rev=48.0, microsteps=2)  # 2 mm a step


@given(st.lists(st.tuples(st.integers(-1, 1), st.integers(-1, 1)), max_size=200))
def test_the_same_steps_backwards_lead_home(steps: list) -> None:
    start = pose = Pose(1.0, 2.0, 0.5)
    for left, right in steps:
        pose = pose_after(pose, Steps(left, right), CONFIG)
    for left, right in reversed(steps):
        pose = pose_after(pose, Steps(-left, -right), CONFIG)
    assert pose[:2] == pytest.approx(start[:2], abs=1e-9)
    assert math.cos(pose.heading_rad - 0.5) == pytest.approx(1.0)


def test_equal_steps_go_straight_and_opposite_steps_turn_on_the_spot() -> None:
    pose = pose_after(Pose(0.0, 0.0, 0.0), Steps(100, 100), CONFIG)
    assert pose == pytest.approx((0.2, 0.0, 0.0))
    pose = pose_after(pose, Steps(-10, 10), CONFIG)
    assert pose == pytest.approx((0.2, 0.0, 0.04 / DRIVE.baseline_m))


def test_the_larger_wheel_goes_the_longer_way() -> None:
    larger = replace(CONFIG, right=MotorConfig("M3M4", gain=1.02))
    pose = pose_after(Pose(0.0, 0.0, 0.0), Steps(100, 100), larger)
    assert pose.heading_rad == pytest.approx(0.004 / DRIVE.baseline_m)
