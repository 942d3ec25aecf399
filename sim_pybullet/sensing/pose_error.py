"""What the overhead localizer tells of N robots: drifting, late, sometimes missing or wrong."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from robot.contract import CONTROL_DT_S
from robot.geometry import wrap_angle
from sim_pybullet.delay_line import DelayLine
from sim_pybullet.look import PoseLook

OUTLIER_M = 1.0  # an outlier is up to this far off in each coordinate


class OverheadPoses(NamedTuple):
    """Poses (N, 3) in the world, NaN rows where none arrived, and capture times (N,) [s]."""

    poses: np.ndarray
    captured_s: np.ndarray


class PoseError:
    """One ``PoseLook`` per robot; errors are Ornstein-Uhlenbeck processes.

    Args:
        dt_s: time between two calls of ``observe``; delays are rounded to whole calls.
    """

    def __init__(self, count: int, dt_s: float = CONTROL_DT_S) -> None:
        self._dt_s = dt_s
        self._deviations = np.zeros((count, 3))
        self._keep = np.ones((count, 1))  # of the error, from one call to the next
        self._delay_s = np.zeros(count)
        self._gap_begins, self._longest_gap_s = np.zeros(count), np.zeros(count)
        self._outlier = np.zeros(count)
        self._errors = np.zeros((count, 3))
        self._gap_s = np.zeros(count)  # rest of the current dropout
        self._sent = DelayLine(count, 3)

    def reset(self, robot: int, look: PoseLook, rng: np.random.Generator) -> None:
        """Begin an episode of one robot, its error drawn from the stationary distribution."""
        self._deviations[robot] = look.position_m, look.position_m, look.heading_rad
        self._keep[robot] = math.exp(-self._dt_s / max(look.correlation_s, 1e-6))
        calls = round(look.delay_s / self._dt_s)
        self._delay_s[robot] = calls * self._dt_s
        self._gap_begins[robot] = look.dropout_per_s * self._dt_s
        self._longest_gap_s[robot] = look.dropout_s
        self._outlier[robot] = look.outlier
        self._errors[robot] = rng.standard_normal(3) * self._deviations[robot]
        self._gap_s[robot] = 0.0
        self._sent.reset(robot, calls, np.full(3, np.nan))

    def of_standing(self, poses: np.ndarray) -> np.ndarray:
        """What was told (N, 3) of robots that have stood at these poses (N, 3) for a while."""
        return _off(poses, self._errors)

    def observe(self, poses: np.ndarray, now_s: float, rng: np.random.Generator) -> OverheadPoses:
        """What arrives now, of true poses (N, 3)."""
        spread = np.sqrt(1.0 - self._keep**2) * self._deviations
        self._errors = self._keep * self._errors + spread * rng.standard_normal(spread.shape)
        seen = _off(poses, self._errors)
        outliers = rng.random(len(poses)) < self._outlier
        jumps = rng.uniform(-OUTLIER_M, OUTLIER_M, (len(poses), 2))
        seen[outliers, :2] += jumps[outliers]
        seen[self._missing(rng)] = np.nan
        self._sent.push(seen)
        arrived = self._sent.read()
        captured_s = np.where(np.isnan(arrived[:, 0]), -math.inf, now_s - self._delay_s)
        return OverheadPoses(arrived, captured_s)

    def _missing(self, rng: np.random.Generator) -> np.ndarray:
        """(N,) bool: in a gap. No gap follows another without a pose between them."""
        begins = (rng.random(len(self._gap_s)) < self._gap_begins) & (self._gap_s <= 0.0)
        self._gap_s -= self._dt_s
        lengths = rng.random(len(self._gap_s)) * self._longest_gap_s
        self._gap_s = np.where(begins, lengths, self._gap_s)
        return np.asarray(self._gap_s > 0.0)


def _off(poses: np.ndarray, errors: np.ndarray) -> np.ndarray:
    seen = poses + errors
    seen[:, 2] = wrap_angle(seen[:, 2])
    return np.asarray(seen)
