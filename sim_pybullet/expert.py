"""The expert: pure pursuit over the five actions, from the true pose and the path.

Coulter 1992, "Implementation of the Pure Pursuit Path Tracking Algorithm": the circle that leaves
along the robot's heading and meets the path a fixed way ahead. Of the five actions the expert
takes the one whose circle is nearest in curvature.
"""

from __future__ import annotations

import numpy as np

from robot.contract import ACTION_TWISTS
from robot.navigation.path_batch import PathBatch

LOOKAHEAD_M = 0.14
_CURVATURES = np.array([twist.turn_radps / twist.forward_mps for twist in ACTION_TWISTS])  # [1/m]


def expert_actions(paths: PathBatch, poses: np.ndarray, arc_m: np.ndarray) -> np.ndarray:
    """The actions (N,) int64 of N experts.

    Args:
        paths: the path of every robot.
        poses: (N, 3) true poses: x [m], y [m], heading [rad].
        arc_m: (N,) where each robot is on its path [m].
    """
    delta = paths.points_at(np.asarray(arc_m)[:, None] + LOOKAHEAD_M)[:, 0] - poses[:, :2]
    heading = poses[:, 2]
    left = np.cos(heading) * delta[:, 1] - np.sin(heading) * delta[:, 0]
    curvature = 2.0 * left / np.maximum((delta**2).sum(axis=1), 1e-6)
    return np.abs(curvature[:, None] - _CURVATURES).argmin(axis=1)
