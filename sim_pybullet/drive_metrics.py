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
        self._sums = np.zeros((4, n_robots))  # way in the lane, offsets [m], steps outside, steps

    def begin(self, robots: np.ndarray) -> None:
        """Forget the episodes of these robots: indices (M,)."""
        self._sums[:, robots] = 0.0

    def add(self, progress_m: np.ndarray, offset_m: np.ndarray, half_lane_m: np.ndarray) -> None:
        """One decision: progress along the path, distance from it, half the lane's width, (N,)."""
        away_m = np.abs(offset_m)
        outside = away_m > half_lane_m
        driven_m = np.where(outside, 0.0, progress_m)
        self._sums += np.stack((driven_m, away_m, outside, np.ones(len(away_m))))

    def metrics(self, i: int) -> DriveMetrics:
        """The episode of robot ``i`` up to now; the mean offset of no decisions is zero."""
        driven_m, offsets_m, outside, steps = self._sums[:, i].tolist()
        return DriveMetrics(
            driven_m,
            steps * CONTROL_DT_S,
            offsets_m * CONTROL_DT_S,
            outside * CONTROL_DT_S,
            offsets_m / max(steps, 1.0),
        )
