"""The filter of a track: a quantity and its rate, which changes by white acceleration.

Bar-Shalom, Li and Kirubarajan, Estimation with Applications to Tracking and Navigation, 2001, 6.3.
"""

from __future__ import annotations

import numpy as np

from robot.geometry import wrap_angle


class RateFilter:
    """Follows ``value`` (N,) and its ``rate``; all coordinates share one covariance (2, 2).

    Args:
        value: as first measured: places [m], or an angle [rad].
        sigma: standard deviation of that.
        rate_sigma: standard deviation of the rate that it may have.
        acceleration: standard deviation of what changes the rate.
        is_angle: runs round, in (-pi, pi].
    """

    def __init__(
        self,
        value: np.ndarray,
        sigma: float,
        rate_sigma: float,
        acceleration: float,
        is_angle: bool = False,
    ) -> None:
        self.value = np.array(value, dtype=float)
        self.rate = np.zeros_like(self.value)
        self.covariance = np.diag([sigma**2, rate_sigma**2])
        self._acceleration, self._is_angle = acceleration, is_angle

    def predict(self, dt_s: float) -> None:
        """Move on by ``dt_s``."""
        f = np.array([[1.0, dt_s], [0.0, 1.0]])
        g = np.array([0.5 * dt_s * dt_s, dt_s]) * self._acceleration
        self.value = self._wrapped(self.value + dt_s * self.rate)
        self.covariance = f @ self.covariance @ f.T + np.outer(g, g)

    def update(self, value: np.ndarray, sigma: float) -> None:
        """Take in a measured value."""
        gain = self.covariance[:, 0] / (self.covariance[0, 0] + sigma**2)
        error = self._wrapped(np.asarray(value) - self.value)
        self.value = self._wrapped(self.value + gain[0] * error)
        self.rate = self.rate + gain[1] * error
        self.covariance = self.covariance - np.outer(gain, self.covariance[0])

    def _wrapped(self, value: np.ndarray) -> np.ndarray:
        return np.asarray(wrap_angle(value)) if self._is_angle else value
