"""The expert: pure pursuit over the five actions, from the true pose and the path.

Coulter 1992, "Implementation of the Pure Pursuit Path Tracking Algorithm": the circle that leaves
along the robot's heading and meets the path a fixed way ahead. Of the five actions the expert
takes the one whose circle is nearest in curvature. It reckons from where the robot will be when
the action takes hold: from the pose alone it fails on the inner lane of ``loop`` with the delay and
the lags of a DB18, with foresight it drives there as well.
"""

from __future__ import annotations

import numpy as np

from robot.contract import ACTION_TWISTS
from robot.path_batch import PathBatch

LOOKAHEAD_M = 0.14
_CURVATURES = np.array([twist.turn_radps / twist.forward_mps for twist in ACTION_TWISTS])  # [1/m]


def expert_actions(
    paths: PathBatch,
    poses: np.ndarray,
    arc_m: np.ndarray,
    twists: np.ndarray,
    response_s: np.ndarray,
) -> np.ndarray:
    """The actions (N,) int64 of N experts.

    Args:
        paths: the path of every robot.
        poses: (N, 3) true poses: x [m], y [m], heading [rad].
        arc_m: (N,) where each robot is on its path [m].
        twists: (N, 2) true forward speeds [m/s] and turn rates [rad/s].
        response_s: (N,) how long an action takes to have its effect.
    """
    way_m, turn_rad = (np.asarray(response_s)[:, None] * twists).T
    middle, heading = poses[:, 2] + 0.5 * turn_rad, poses[:, 2] + turn_rad
    there = poses[:, :2] + np.stack((way_m * np.cos(middle), way_m * np.sin(middle)), axis=1)
    delta = paths.points_at((arc_m + way_m)[:, None] + LOOKAHEAD_M)[:, 0] - there
    left = np.cos(heading) * delta[:, 1] - np.sin(heading) * delta[:, 0]
    curvature = 2.0 * left / np.maximum((delta**2).sum(axis=1), 1e-6)
    return np.abs(curvature[:, None] - _CURVATURES).argmin(axis=1)
