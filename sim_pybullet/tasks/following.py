"""Robots on paths: where they are, and the reward of paper A for being there."""

import math
from typing import NamedTuple

import numpy as np

from robot.contract import ACTION_TWISTS, CONTROL_DT_S, Action

# From the middle of a lane to its edge: the yellow line begins at 0.18 tiles, the white at 0.193.
HALF_LANE_TILES = 0.19
NOMINAL_STEP_M = ACTION_TWISTS[Action.STRAIGHT].forward_mps * CONTROL_DT_S
MAX_HEADING_ERROR_RAD = math.radians(100.0)
START_OFFSET = 0.25  # at most, in half-lane widths
START_HEADING_RAD = math.radians(10.0)  # at most
DAWDLE = 2.0  # an episode may take this many times as long as driving straight ahead would
TERM_NAMES = ("offset", "alignment")


class Course(NamedTuple):
    """Where N robots are on the paths they should follow."""

    arc_m: np.ndarray  # (N,) along the path
    offset_m: np.ndarray  # (N,) from the path, positive to the left
    heading_error_rad: np.ndarray  # (N,) the robot's heading less the path's, in (-pi, pi]
    progress_m: np.ndarray  # (N,) along the path in the last decision
    travelled_m: np.ndarray  # (N,) along the path in this episode


def following_terms(course: Course, half_lane_m: np.ndarray) -> np.ndarray:
    """Paper A's reward -5 |dE| + 5 dot of N robots as two terms (2, N), named TERM_NAMES.

    * ``offset``: -5 |dE|, dE the distance from the path in half-lane widths (N,) [m];
    * ``alignment``: 5 dot, dot the cosine between the headings of robot and path. Where it is
      positive it is earned by driving: times the progress along the path as a share (0 to 1) of
      what STRAIGHT makes in a decision (3 cm). A parked robot never gets more than zero in all.
    """
    dot = np.cos(course.heading_error_rad)
    speed = np.clip(course.progress_m / NOMINAL_STEP_M, 0.0, 1.0)
    offset = np.abs(course.offset_m) / half_lane_m
    return np.stack((-5.0 * offset, 5.0 * np.minimum(dot, dot * speed)))
