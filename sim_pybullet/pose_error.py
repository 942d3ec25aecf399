"""What the overhead localizer tells of N robots: drifting, late, sometimes missing or wrong."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from robot.geometry import wrap_angle
from sim_pybullet.look import PoseLook

OUTLIER_M = 1.0  # an outlier is up to this far off in each coordinate


class OverheadPoses(NamedTuple):
    """Poses (N, 3) in the world, NaN rows where none arrived, and capture times (N,) [s]."""

    poses: np.ndarray
    captured_s: np.ndarray


class PoseError:
    """One ``PoseLook`` per robot; errors are Ornstein-Uhlenbeck processes.

    Delays are rounded to whole calls of ``observe``, which the caller makes at a steady rate.
    """

    def __init__(self, count: int) -> None:
        self._looks = [PoseLook()] * count
        self._errors = np.zeros((count, 3))
        self._gap_s = np.zeros(count)  # rest of the current dropout
        self._queues: list[list[tuple[float, np.ndarray]]] = [[] for _ in range(count)]

    def reset(self, robot: int, look: PoseLook, rng: np.random.Generator) -> None:
        """Begin an episode of one robot, its error drawn from the stationary distribution."""
        self._looks[robot] = look
        self._errors[robot] = rng.standard_normal(3) * _deviations(look)
        self._gap_s[robot] = 0.0
        self._queues[robot].clear()

    def observe(
        self, poses: np.ndarray, now_s: float, dt_s: float, rng: np.random.Generator
    ) -> OverheadPoses:
        """What arrives now, ``dt_s`` after the last call, of true poses (N, 3)."""
        self._drift(dt_s, rng)
        self._drop_out(dt_s, rng)
        seen = poses + self._errors
        outliers = rng.random(len(poses)) < [look.outlier for look in self._looks]
        seen[outliers, :2] += rng.uniform(-OUTLIER_M, OUTLIER_M, (int(outliers.sum()), 2))
        seen[:, 2] = wrap_angle(seen[:, 2])
        arrived = np.full_like(seen, np.nan)
        captured_s = np.full(len(seen), -math.inf)
        for robot, look in enumerate(self._looks):
            queue = self._queues[robot]
            if self._gap_s[robot] <= 0.0:
                queue.append((now_s, seen[robot]))
            while queue and queue[0][0] <= now_s - look.delay_s + 0.5 * dt_s:
                captured_s[robot], arrived[robot] = queue.pop(0)
        return OverheadPoses(arrived, captured_s)

    def _drift(self, dt_s: float, rng: np.random.Generator) -> None:
        keep = np.array([math.exp(-dt_s / max(k.correlation_s, 1e-6)) for k in self._looks])[
            :, None
        ]
        spread = np.sqrt(1.0 - keep * keep) * _stack(self._looks)
        self._errors = keep * self._errors + spread * rng.standard_normal(self._errors.shape)

    def _drop_out(self, dt_s: float, rng: np.random.Generator) -> None:
        self._gap_s -= dt_s
        begins = rng.random(len(self._looks)) < [k.dropout_per_s * dt_s for k in self._looks]
        lengths = rng.random(len(self._looks)) * [k.dropout_s for k in self._looks]
        self._gap_s = np.where(begins & (self._gap_s <= 0.0), lengths, self._gap_s)


def _deviations(look: PoseLook) -> np.ndarray:
    return np.array([look.position_m, look.position_m, look.heading_rad])


def _stack(looks: Sequence[PoseLook]) -> np.ndarray:
    return np.array([_deviations(look) for look in looks])
