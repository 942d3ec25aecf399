"""Which bodies are near the ways of road users, in compiled code."""

import math

import numpy as np
from numba import njit

from sim_pybullet.traffic.ahead import AHEAD_M


@njit(cache=True)
def steps_ahead(
    points: np.ndarray, poses: np.ndarray, bodies: np.ndarray, clear_m: np.ndarray
) -> np.ndarray:
    """(N, B) how many steps robots have before they would come too near to each body.

    Args:
        points: (N, K, 2) of their paths, at ``AHEAD_M``.
        poses: (N, 3) their own; what is behind them does not count.
        bodies: (N, B, 2) what is around each, NaN for what is not there.
        clear_m: (N, B) how far away it must stay.
    """
    steps = np.full(bodies.shape[:2], len(AHEAD_M))
    for i in range(len(poses)):
        x_m, y_m, c, s = poses[i, 0], poses[i, 1], math.cos(poses[i, 2]), math.sin(poses[i, 2])
        for j in range(bodies.shape[1]):
            bx_m, by_m = bodies[i, j]
            if c * (bx_m - x_m) + s * (by_m - y_m) > 0.0:
                for k in range(len(AHEAD_M)):
                    square = (points[i, k, 0] - bx_m) ** 2 + (points[i, k, 1] - by_m) ** 2
                    if square < clear_m[i, j] ** 2:
                        steps[i, j] = k
                        break
    return steps
