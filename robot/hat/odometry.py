"""Where the robot is, from the steps it made: exact arcs of a differential drive."""

from __future__ import annotations

from typing import Tuple

from robot.geometry import DifferentialDrive, Pose
from robot.hat.stepping import Steps


class StepOdometry:
    """Adds up steps, from ``pose`` on (world frame).

    Args:
        drive: the axle.
        wheel_steps_m: rim movement of a step, left and right [m].
        pose: to begin with.

    True as long as no rotor loses a step and no wheel slips.
    """

    def __init__(
        self, drive: DifferentialDrive, wheel_steps_m: Tuple[float, float], pose: Pose
    ) -> None:
        self._drive = drive
        self._wheel_steps_m = wheel_steps_m
        self.pose = pose

    def add(self, steps: Steps) -> None:
        """Both wheels moved by these steps at the same time."""
        left_m, right_m = (n * step_m for n, step_m in zip(steps, self._wheel_steps_m))
        turn_rad = (right_m - left_m) / self._drive.baseline_m
        self.pose = self.pose.moved(0.5 * (left_m + right_m), turn_rad)
