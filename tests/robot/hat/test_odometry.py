import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from robot.geometry import DifferentialDrive, Pose
from robot.hat.odometry import StepOdometry
from robot.hat.stepping import Steps

DRIVE = DifferentialDrive()


@given(st.lists(st.tuples(st.integers(-1, 1), st.integers(-1, 1)), max_size=200))
def test_the_same_steps_backwards_lead_home(steps: list) -> None:
    start = Pose(1.0, 2.0, 0.5)
    odometry = StepOdometry(DRIVE, (0.002, 0.002), start)
    for left, right in steps:
        odometry.add(Steps(left, right))
    for left, right in reversed(steps):
        odometry.add(Steps(-left, -right))
    assert odometry.pose[:2] == pytest.approx(start[:2], abs=1e-9)
    assert math.cos(odometry.pose.heading_rad - 0.5) == pytest.approx(1.0)


def test_equal_steps_go_straight_and_opposite_steps_turn_on_the_spot() -> None:
    odometry = StepOdometry(DRIVE, (0.002, 0.002), Pose(0.0, 0.0, 0.0))
    odometry.add(Steps(100, 100))
    assert odometry.pose == pytest.approx((0.2, 0.0, 0.0))
    odometry.add(Steps(-10, 10))
    assert odometry.pose == pytest.approx((0.2, 0.0, 0.04 / DRIVE.baseline_m))


def test_the_larger_wheel_goes_the_longer_way() -> None:
    odometry = StepOdometry(DRIVE, (0.002, 0.00204), Pose(0.0, 0.0, 0.0))
    odometry.add(Steps(100, 100))
    assert odometry.pose.heading_rad == pytest.approx(0.004 / DRIVE.baseline_m)
