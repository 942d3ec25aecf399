"""``Vehicle``: what carries out the actions of a task, N at once."""

from __future__ import annotations

from typing import Protocol

import numpy as np

from robot.contract import ACTION_WHEELS, MAX_WHEEL_MPS, ActionTable
from robot.navigation.path_batch import PathBatch
from sim_pybullet.expert import expert_actions
from sim_pybullet.look import DriveLook
from sim_pybullet.motors import MotorModel

ACTION_TABLE = np.array(ACTION_WHEELS)  # (5, 2) left and right rim speed [m/s]


class Vehicle(Protocol):
    """N vehicles, each with a ``DriveLook`` of its own."""

    @property
    def actions(self) -> ActionTable:
        """The choices, each as two numbers; what they mean is the vehicle's affair."""

    @property
    def counted(self) -> np.ndarray:
        """(N, 2) forward speed [m/s] and turn rate [rad/s] as the wheels' odometry has them."""

    def reset(self, i: int, look: DriveLook) -> None:
        """Vehicle ``i`` stands still and drives after ``look``."""

    def step(self, actions: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        """Advance by one physics step under actions (N,), or any pairs (N, 2) from -1 to 1.

        Returns:
            (N, 2) forward speed [m/s] and turn rate [rad/s] at the end of the step.
        """

    def expert(self, paths: PathBatch, poses: np.ndarray, arc_m: np.ndarray) -> np.ndarray:
        """(N,) what a driver would choose who knows the true poses (N, 3) and the path."""


class WheeledRobots:
    """The project's robot: five actions, each a pair of wheel speeds, and its motors."""

    def __init__(self, n_robots: int) -> None:
        self._motors = MotorModel(n_robots)

    @property
    def actions(self) -> ActionTable:
        """Left and right rim speed [m/s] of `robot.contract.Action`."""
        return tuple((wheels[0], wheels[1]) for wheels in ACTION_WHEELS)

    @property
    def counted(self) -> np.ndarray:
        """See `sim_pybullet.motors.MotorModel.counted`."""
        return self._motors.counted

    def reset(self, i: int, look: DriveLook) -> None:
        """Robot ``i`` stands still, with no command under way."""
        self._motors.reset(i, look)

    def step(self, actions: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        """Advance by one physics step; (N, 2) forward speed [m/s] and turn rate [rad/s].

        Pairs are left and right rim speed as shares of the greatest in the table.
        """
        speeds = ACTION_TABLE[actions] if actions.ndim == 1 else MAX_WHEEL_MPS * actions
        return self._motors.step(speeds, rng)

    def expert(self, paths: PathBatch, poses: np.ndarray, arc_m: np.ndarray) -> np.ndarray:
        """(N,) see `sim_pybullet.expert`."""
        return expert_actions(paths, poses, arc_m)
