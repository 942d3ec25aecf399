"""Where the robot is: late, noisy overhead poses fused with its own step odometry.

An extended Kalman filter on (x, y, heading) (Thrun, Burgard and Fox, Probabilistic Robotics, 5.4
and 7.4). Steps move the estimate at once; an overhead pose corrects the estimate of the moment its
picture was taken, and the motion since is replayed. N robots at once: the simulator runs the very
filter of the robot.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import List

import numpy as np

from robot.geometry import wrap_angle

HISTORY_S = 3.0  # older pictures are refused
UNKNOWN_HEADING_RAD = 1e3  # standard deviation of a heading that was not measured


@dataclass(frozen=True)
class FusionConfig:
    """Standard deviations of what goes into the filter. The overhead defaults are the arena's."""

    position_m: float = 0.03  # of an overhead position
    heading_rad: float = math.radians(5.0)
    # Overhead errors drift over 2 s or so; averaging that long lets the heading error of the steps
    # swing the position (3.7 cm instead of 3.0 cm, tests/robot/test_fusion.py).
    correlation_s: float = 0.5
    step_error: float = 0.03  # of the distance driven, per square root of a metre
    turn_error: float = 0.1  # of the angle turned: tyres scrub, baselines are not exact
    drift_rad_per_m: float = 0.05  # heading drift while driving straight
    gate: float = 16.3  # squared Mahalanobis distance that 1 of 1000 honest poses exceeds
    rejections: int = 5  # so many unbelievable poses in a row mean that the estimate is wrong


def compose(pose: np.ndarray, step: np.ndarray) -> np.ndarray:
    """Poses (N, 3) moved by steps (N, 3) given in each pose's own frame."""
    c, s = np.cos(pose[:, 2]), np.sin(pose[:, 2])
    x = pose[:, 0] + c * step[:, 0] - s * step[:, 1]
    y = pose[:, 1] + s * step[:, 0] + c * step[:, 1]
    return np.stack((x, y, wrap_angle(pose[:, 2] + step[:, 2])), axis=1)


def between(start: np.ndarray, end: np.ndarray) -> np.ndarray:
    """The steps (N, 3) that lead from poses ``start`` to ``end``: compose(start, step) == end."""
    delta = end[:, :2] - start[:, :2]
    c, s = np.cos(start[:, 2]), np.sin(start[:, 2])
    x = c * delta[:, 0] + s * delta[:, 1]
    y = -s * delta[:, 0] + c * delta[:, 1]
    return np.stack((x, y, wrap_angle(end[:, 2] - start[:, 2])), axis=1)


class PoseFusion:
    """The filter of ``count`` robots. Times come from the caller's one clock.

    Attributes:
        poses: (N, 3) estimate in the world; NaN until the first overhead pose.
        rejected: (N,) overhead poses in a row that were too far off to believe.
    """

    def __init__(self, count: int = 1, config: FusionConfig = FusionConfig()) -> None:
        self.config = config
        self.poses = np.full((count, 3), np.nan)
        self.rejected = np.zeros(count, dtype=int)
        self._covariance = np.zeros((count, 3, 3))
        self._measured_s = np.full(count, -math.inf)
        self._odometry = np.zeros((count, 3))
        self._times_s: List[float] = []
        self._history: List[np.ndarray] = []  # odometry (N, 3) at each time

    def reset(self, robots: np.ndarray) -> None:
        """Forget where these robots (boolean mask or indices) are."""
        self.poses[robots] = np.nan
        self.rejected[robots] = 0
        self._measured_s[robots] = -math.inf

    @property
    def position_sd_m(self) -> np.ndarray:
        """(N,) standard deviation of the worse coordinate [m]."""
        return np.sqrt(np.max(self._covariance[:, (0, 1), (0, 1)], axis=1))

    def move(self, forward_m: np.ndarray, turn_rad: np.ndarray, now_s: float) -> None:
        """Dead-reckon arcs (N,) [m], (N,) [rad] that end ``now_s``; for every tick."""
        half = 0.5 * turn_rad
        chord = forward_m * np.sinc(half / math.pi)
        step = np.stack((chord * np.cos(half), chord * np.sin(half), turn_rad), axis=1)
        self._odometry = compose(self._odometry, step)
        self._times_s.append(now_s)
        self._history.append(self._odometry)
        while self._times_s[0] < now_s - HISTORY_S:
            del self._times_s[0], self._history[0]
        moved = compose(self.poses, step)
        self._covariance = _carry(self._covariance, moved[:, :2] - self.poses[:, :2])
        self._covariance += self._step_noise(forward_m, turn_rad, self.poses[:, 2])
        self.poses = moved

    def measure(self, measured: np.ndarray, captured_s: np.ndarray) -> None:
        """Take overhead poses (N, 3) of pictures taken at times (N,) [s].

        A row of NaN is a robot without a new pose; a heading alone may be NaN too. Poses that the
        filter cannot believe, or older than its memory, are counted in ``rejected`` and ignored.
        """
        config, then = self.config, self._odometry_at(captured_s)
        since = between(then, self._odometry)
        fresh = np.isfinite(measured[:, :2]).all(axis=1) & (captured_s > self._measured_s)
        unknown = np.isnan(self.poses[:, 0]) | (self.rejected >= config.rejections)
        lost = fresh & unknown & np.isfinite(measured[:, 2])
        noise = self._measurement_noise(measured)
        past = np.where(lost[:, None], measured, _uncompose(self.poses, since))
        displaced = compose(past, since)[:, :2] - past[:, :2]
        covariance = np.where(lost[:, None, None], noise, _carry(self._covariance, -displaced))
        innovation = measured - past
        innovation[:, 2] = np.where(
            np.isnan(measured[:, 2]), 0.0, wrap_angle(np.nan_to_num(innovation[:, 2]))
        )
        innovation = np.nan_to_num(innovation)
        believed = fresh & (_mahalanobis(innovation, covariance + noise) < config.gate) & ~lost
        believed &= np.isfinite(past[:, 0]) & np.isfinite(then[:, 0])
        # Errors that drift with a time constant T carry one independent pose per 2 T.
        since_last_s = np.where(believed, captured_s, 1.0) - np.where(
            believed, self._measured_s, 0.0
        )
        repeats = np.maximum(2.0 * config.correlation_s / since_last_s, 1.0)
        gain = covariance @ np.linalg.inv(_regular(covariance + noise * repeats[:, None, None]))
        corrected = past + np.einsum("nij,nj->ni", gain, innovation)
        corrected[:, 2] = wrap_angle(corrected[:, 2])
        new_poses = compose(np.where(believed[:, None], corrected, past), since)
        smaller = (np.eye(3) - gain) @ covariance
        smaller = np.where(believed[:, None, None], smaller, covariance)
        taken = believed | lost
        self.poses = np.where(taken[:, None], new_poses, self.poses)
        self._covariance = np.where(
            taken[:, None, None], _carry(smaller, displaced), self._covariance
        )
        self._measured_s = np.where(taken, captured_s, self._measured_s)
        self.rejected = np.where(taken, 0, self.rejected + fresh)

    def age_s(self, now_s: float) -> np.ndarray:
        """(N,) time since the picture of the last overhead pose that was taken [s]."""
        return now_s - self._measured_s

    def _odometry_at(self, when_s: np.ndarray) -> np.ndarray:
        """Odometry (N, 3) at times (N,), interpolated; NaN before the history begins."""
        times = np.array(self._times_s)
        after = np.clip(np.searchsorted(times, when_s), 1, max(len(times) - 1, 1))
        if len(times) < 2:
            return np.where((when_s >= times[0])[:, None], self._odometry, np.nan)
        share = (when_s - times[after - 1]) / (times[after] - times[after - 1])
        history, robots = np.stack(self._history), np.arange(len(when_s))
        before = history[after - 1, robots]
        step = between(before, history[after, robots])
        at = compose(before, step * np.clip(share, 0.0, 1.0)[:, None])
        return np.where((when_s >= times[0])[:, None], at, np.nan)

    def _step_noise(self, forward: np.ndarray, turn: np.ndarray, heading: np.ndarray) -> np.ndarray:
        config = self.config
        length = np.abs(forward)
        along = config.step_error**2 * length
        turning = (config.turn_error * turn) ** 2 + config.drift_rad_per_m**2 * length
        c, s = np.cos(heading), np.sin(heading)
        noise = np.zeros((len(forward), 3, 3))
        noise[:, 0, 0], noise[:, 1, 1] = along * c * c, along * s * s
        noise[:, 0, 1] = noise[:, 1, 0] = along * c * s
        noise[:, 2, 2] = turning
        return noise

    def _measurement_noise(self, measured: np.ndarray) -> np.ndarray:
        config = self.config
        heading = np.where(np.isnan(measured[:, 2]), UNKNOWN_HEADING_RAD, config.heading_rad)
        noise = np.zeros((len(measured), 3, 3))
        noise[:, 0, 0] = noise[:, 1, 1] = config.position_m**2
        noise[:, 2, 2] = heading**2
        return noise


def _uncompose(pose: np.ndarray, step: np.ndarray) -> np.ndarray:
    """The poses from which ``step`` led to ``pose``."""
    heading = wrap_angle(pose[:, 2] - step[:, 2])
    c, s = np.cos(heading), np.sin(heading)
    x = pose[:, 0] - (c * step[:, 0] - s * step[:, 1])
    y = pose[:, 1] - (s * step[:, 0] + c * step[:, 1])
    return np.stack((x, y, heading), axis=1)


def _carry(covariance: np.ndarray, displaced_m: np.ndarray) -> np.ndarray:
    """Covariance (N, 3, 3) after displacements (N, 2): a heading error swings the position."""
    jacobian = np.zeros_like(covariance)
    jacobian[:, (0, 1, 2), (0, 1, 2)] = 1.0
    moved = np.nan_to_num(displaced_m)
    jacobian[:, 0, 2], jacobian[:, 1, 2] = -moved[:, 1], moved[:, 0]
    return jacobian @ covariance @ jacobian.transpose(0, 2, 1)


def _mahalanobis(innovation: np.ndarray, covariance: np.ndarray) -> np.ndarray:
    solved = np.linalg.solve(_regular(covariance), innovation[..., None])[..., 0]
    return np.einsum("ni,ni->n", innovation, solved)


def _regular(covariance: np.ndarray) -> np.ndarray:
    """The same with a trace of variance, so that an unknown robot does not stop the others."""
    return np.nan_to_num(covariance) + 1e-12 * np.eye(3)
