"""``Vehicle``: what carries out the actions of a task, N at once; the project's robot is one."""

from typing import Protocol

import numpy as np

from robot.contract import ACTION_TWISTS, ACTION_WHEELS, FIVE_ACTIONS, MAX_WHEEL_MPS, ActionTable
from robot.navigation.path import PathBatch
from sim_pybullet.look import DriveLook
from sim_pybullet.motors import MotorModel

ACTION_TABLE = np.array(ACTION_WHEELS)  # (5, 2) left and right rim speed [m/s]
LOOKAHEAD_M = 0.14
_CURVATURES = np.array([twist.turn_radps / twist.forward_mps for twist in ACTION_TWISTS])  # [1/m]


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


class WheeledRobots(MotorModel):
    """The project's robot: five actions, each a pair of wheel speeds, and its motors."""

    actions: ActionTable = FIVE_ACTIONS

    def step(self, actions: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        """As of `Vehicle`; pairs are rim speeds as shares of the greatest of our actions."""
        table = np.array(self.actions)
        speeds = table[actions] if actions.ndim == 1 else MAX_WHEEL_MPS * actions
        return super().step(speeds, rng)

    def expert(self, paths: PathBatch, poses: np.ndarray, arc_m: np.ndarray) -> np.ndarray:
        """(N,) see `expert_actions`."""
        return expert_actions(paths, poses, arc_m)


def expert_actions(
    paths: PathBatch, poses: np.ndarray, arc_m: np.ndarray, ahead_m: float = LOOKAHEAD_M
) -> np.ndarray:
    """The actions (N,) of experts at true poses (N, 3): whose circle is nearest to `pursuit`'s."""
    curvature = pursuit(paths, poses, np.asarray(arc_m) + ahead_m)
    return np.abs(curvature[:, None] - _CURVATURES).argmin(axis=1)


def pursuit(paths: PathBatch, poses: np.ndarray, ahead_m: np.ndarray) -> np.ndarray:
    """(N,) curvature [1/m] of the circles that lead from poses (N, 3) to places on the paths (N,).

    Coulter 1992, "Implementation of the Pure Pursuit Path Tracking Algorithm": the circle that
    leaves along the robot's heading and meets the path a fixed way ahead.
    """
    delta = paths.points_at(ahead_m[:, None])[:, 0] - poses[:, :2]
    left = np.cos(poses[:, 2]) * delta[:, 1] - np.sin(poses[:, 2]) * delta[:, 0]
    return np.asarray(2.0 * left / np.maximum((delta**2).sum(axis=1), 1e-6))
