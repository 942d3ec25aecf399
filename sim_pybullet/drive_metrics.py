"""How well robots drove: the figures by which the AI Driving Olympics judged lane following.

Zilly et al. 2019, "The AI Driving Olympics at NeurIPS 2018", section on metrics: way driven along
the lane, survival time, lateral deviation integrated over time, time outside the lane.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from robot.contract import CONTROL_DT_S


class DriveMetrics(NamedTuple):
    """One episode of one robot."""

    driven_lane_m: float  # along the path, while in the lane
    survival_time_s: float
    deviation_m_s: float  # integral of the distance from the path over time
    outside_lane_s: float
    mean_offset_m: float  # mean distance from the path


class DriveRecorder:
    """Adds up the figures of N robots while they drive."""

    def __init__(self, n_robots: int) -> None:
        self._driven_m, self._offset_m = np.zeros(n_robots), np.zeros(n_robots)
        self._outside, self._steps = np.zeros(n_robots, dtype=int), np.zeros(n_robots, dtype=int)

    def begin(self, robots: np.ndarray) -> None:
        """Forget the episodes of these robots: indices (M,)."""
        for total in (self._driven_m, self._offset_m, self._outside, self._steps):
            total[robots] = 0

    def add(self, progress_m: np.ndarray, offset_m: np.ndarray, half_lane_m: np.ndarray) -> None:
        """One decision: progress along the path, distance from it, half the lane's width, (N,)."""
        outside = np.abs(offset_m) > half_lane_m
        self._driven_m += np.where(outside, 0.0, progress_m)
        self._offset_m += np.abs(offset_m)
        self._outside += outside
        self._steps += 1

    def metrics(self, i: int) -> DriveMetrics:
        """The episode of robot ``i`` up to now; the mean offset of no decisions is zero."""
        steps = int(self._steps[i])
        return DriveMetrics(
            float(self._driven_m[i]),
            steps * CONTROL_DT_S,
            float(self._offset_m[i]) * CONTROL_DT_S,
            int(self._outside[i]) * CONTROL_DT_S,
            float(self._offset_m[i]) / max(steps, 1),
        )
