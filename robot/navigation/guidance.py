"""``path_input``: what the planned path looks like from the robot, as ten angles.

Paper A, section 3.3: the angles from the robot to the ten nearest points ahead on its path, between
-45 and 45 degrees, normalised. A policy for navigation gets them beside the picture.
"""

from __future__ import annotations

from typing import Optional

import numpy as np

from robot.contract import PATH_ANGLE_LIMIT_RAD, PATH_POINTS
from robot.geometry import Pose
from robot.navigation.path import Path, PathBatch

POINT_SPACING_M = 0.04  # along the path; ten of them reach a little farther than one tile's corner
FIRST_POINT_M = 0.06  # ahead of the robot: nearer ones swing wildly with the smallest offset
_AHEAD_M = FIRST_POINT_M + POINT_SPACING_M * np.arange(PATH_POINTS)


def path_inputs(paths: PathBatch, poses: np.ndarray, arc_m: np.ndarray) -> np.ndarray:
    """(N, PATH_POINTS) float32 in [-1, 1], nearest point first; positive is to the left.

    Of N robots at poses (N, 3), who are on their paths at ``arc_m`` (N,) of `PathBatch.project`.
    Beyond the end of an open path the points go on straight.
    """
    poses = np.asarray(poses, dtype=float)
    delta = paths.points_at(np.asarray(arc_m)[:, None] + _AHEAD_M) - poses[:, None, :2]
    c, s = np.cos(poses[:, 2:]), np.sin(poses[:, 2:])
    forward = c * delta[..., 0] + s * delta[..., 1]
    left = c * delta[..., 1] - s * delta[..., 0]
    angle = np.clip(np.arctan2(left, forward), -PATH_ANGLE_LIMIT_RAD, PATH_ANGLE_LIMIT_RAD)
    return (angle / PATH_ANGLE_LIMIT_RAD).astype(np.float32)


def path_input(path: Path, pose: Pose, hint: Optional[int] = None) -> np.ndarray:
    """The path input of one robot, (PATH_POINTS,) float32; see `path_inputs`.

    ``hint`` is the ``index`` of the last `Path.project`; without it the whole path is searched.
    """
    arc_m = path.project(pose.x_m, pose.y_m, hint).arc_m
    return path_inputs(path.batch, np.array([pose]), np.array([arc_m]))[0]
