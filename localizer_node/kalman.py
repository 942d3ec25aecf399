"""The two filters of a track: constant velocity on the floor, constant turn rate for the heading.

Bar-Shalom, Li and Kirubarajan, Estimation with Applications to Tracking and Navigation, 2001, 6.3.
"""

from __future__ import annotations

from typing import Tuple

import numpy as np

from robot.geometry import wrap_angle

ACCELERATION_MPS2 = 2.0  # standard deviation: a stepper starts and stops within a tenth of a second
TURN_ACCELERATION_RADPS2 = 40.0  # from one hard turn to the other as fast
START_SPEED_MPS = 0.3
START_TURN_RADPS = 2.0


def _transition(dt_s: float, acceleration: float) -> Tuple[np.ndarray, np.ndarray]:
    """F and Q of one coordinate and its rate, for white acceleration held over the step."""
    f = np.array([[1.0, dt_s], [0.0, 1.0]])
    g = np.array([0.5 * dt_s * dt_s, dt_s]) * acceleration
    return f, np.outer(g, g)


class FloorFilter:
    """Position and velocity on the floor; both coordinates share one covariance (2, 2)."""

    def __init__(self, position_m: np.ndarray, sigma_m: float) -> None:
        self.position_m = np.array(position_m, dtype=float)  # (2,)
        self.velocity_mps = np.zeros(2)
        self.covariance = np.diag([sigma_m**2, START_SPEED_MPS**2])

    def predict(self, dt_s: float) -> None:
        """Move on by ``dt_s``."""
        f, q = _transition(dt_s, ACCELERATION_MPS2)
        self.position_m = self.position_m + dt_s * self.velocity_mps
        self.covariance = f @ self.covariance @ f.T + q

    def update(self, position_m: np.ndarray, sigma_m: float) -> None:
        """Take in a measured position."""
        gain = self.covariance[:, 0] / (self.covariance[0, 0] + sigma_m**2)
        error = position_m - self.position_m
        self.position_m = self.position_m + gain[0] * error
        self.velocity_mps = self.velocity_mps + gain[1] * error
        self.covariance = self.covariance - np.outer(gain, self.covariance[0])


class HeadingFilter:
    """Heading and turn rate."""

    def __init__(self, heading_rad: float, sigma_rad: float) -> None:
        self.heading_rad = heading_rad
        self.turn_radps = 0.0
        self.covariance = np.diag([sigma_rad**2, START_TURN_RADPS**2])

    def predict(self, dt_s: float) -> None:
        """Turn on by ``dt_s``."""
        f, q = _transition(dt_s, TURN_ACCELERATION_RADPS2)
        self.heading_rad = float(wrap_angle(self.heading_rad + dt_s * self.turn_radps))
        self.covariance = f @ self.covariance @ f.T + q

    def update(self, heading_rad: float, sigma_rad: float) -> None:
        """Take in a measured heading."""
        gain = self.covariance[:, 0] / (self.covariance[0, 0] + sigma_rad**2)
        error = float(wrap_angle(heading_rad - self.heading_rad))
        self.heading_rad = float(wrap_angle(self.heading_rad + gain[0] * error))
        self.turn_radps += float(gain[1] * error)
        self.covariance = self.covariance - np.outer(gain, self.covariance[0])
