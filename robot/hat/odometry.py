"""Where the robot is, from the steps it made: exact arcs of a differential drive."""

from __future__ import annotations

from robot.geometry import DifferentialDrive, Pose
from robot.hat.stepping import Steps


class StepOdometry:
    """Adds up steps, each a rim movement of ``step_m`` [m], from ``pose`` on (world frame).

    True as long as no rotor loses a step and no wheel slips.
    """

    def __init__(self, drive: DifferentialDrive, step_m: float, pose: Pose) -> None:
        self._drive = drive
        self._step_m = step_m
        self.pose = pose

    def add(self, steps: Steps) -> None:
        """Both wheels moved by these steps at the same time."""
        left_m, right_m = steps.left * self._step_m, steps.right * self._step_m
        turn_rad = (right_m - left_m) / self._drive.baseline_m
        self.pose = self.pose.moved(0.5 * (left_m + right_m), turn_rad)
