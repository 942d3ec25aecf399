"""What is ahead of robots on their paths, and how soon they would meet it."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

DUCK_M, ROBOT_M = 0.10, 0.15  # centres nearer than that have met (the AI Driving Olympics' rules)
STEP_M = 0.04
AHEAD_M = STEP_M * np.arange(1, 26)  # where a path is looked at
NOTHING = -1
_STILL_MPS = 1e-3


class Ahead(NamedTuple):
    """How far robots can go along their paths; what ends that way, or `NOTHING`."""

    free_m: np.ndarray  # (...) at most 1 m
    what: np.ndarray  # (...) int, index of the body


def look_ahead(
    points: np.ndarray, poses: np.ndarray, bodies: np.ndarray, clear_m: np.ndarray
) -> Ahead:
    """The way that robots have before they would come too near to something.

    Args:
        points: (N, K, 2) of their paths, at ``AHEAD_M``.
        poses: (N, 3) their own; what is behind them does not count.
        bodies: (N, B, 2) what is around each, NaN for what is not there.
        clear_m: (N, B) how far away it must stay.
    """
    forward = _in_front(poses, bodies)
    delta = bodies[:, None] - points[:, :, None]
    near = ((delta**2).sum(axis=-1) < clear_m[:, None] ** 2) & (forward > 0.0)[:, None]
    first = np.where(near.any(axis=1), near.argmax(axis=1), len(AHEAD_M))  # (N, B)
    what = first.argmin(axis=1)
    steps = np.take_along_axis(first, what[:, None], axis=1)[:, 0]
    return Ahead(steps * STEP_M, np.where(steps < len(AHEAD_M), what, NOTHING))


def _in_front(poses: np.ndarray, bodies: np.ndarray) -> np.ndarray:
    """(N, B) how far ahead bodies (N, B, 2) are along the robots' headings [m]."""
    delta = bodies - poses[:, None, :2]
    c, s = np.cos(poses[:, 2:]), np.sin(poses[:, 2:])
    return np.asarray(c * delta[..., 0] + s * delta[..., 1])


def behind(poses: np.ndarray, bodies: np.ndarray) -> np.ndarray:
    """(N, B) bool: whether a body is behind a robot's axle."""
    return _in_front(poses, bodies) < 0.0


def time_to_collision(
    offsets_m: np.ndarray, velocities_mps: np.ndarray, radii_m: np.ndarray
) -> np.ndarray:
    """(...) seconds until two centres are as near as a radius if both go on as they do.

    ``offsets_m`` and ``velocities_mps`` (..., 2) are of the one as the other has it. Infinite where
    they never meet, or one is not there (NaN); 0 where they have met.
    """
    closing = (velocities_mps**2).sum(axis=-1)
    along = (offsets_m * velocities_mps).sum(axis=-1)
    apart = (offsets_m**2).sum(axis=-1) - radii_m**2
    root = along**2 - closing * apart
    meets = (along < 0.0) & (root >= 0.0) & (closing > _STILL_MPS**2)
    after_s = (-along - np.sqrt(np.maximum(root, 0.0))) / np.maximum(closing, _STILL_MPS**2)
    return np.where(apart <= 0.0, 0.0, np.where(meets, after_s, np.inf))
