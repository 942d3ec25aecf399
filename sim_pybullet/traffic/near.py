"""Which bodies are near the ways of road users, in compiled code."""

import math

import numpy as np
from numba import njit

from sim_pybullet.traffic.ahead import AHEAD_M


@njit(cache=True)
def steps_ahead(
    points: np.ndarray, poses: np.ndarray, bodies: np.ndarray, clear_m: np.ndarray
) -> np.ndarray:
    """(N, B) how many steps robots at poses (N, 3) have before they come too near to each body.

    ``points`` (N, K, 2) are of their paths, at ``AHEAD_M``; ``bodies`` (N, B, 2), NaN where one is
    not there, must stay ``clear_m`` (N, B) away, but for those behind.
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
