"""How far the ways of road users are free, and what ends them."""

import numpy as np

STEP_M = 0.04
AHEAD_M = STEP_M * np.arange(1, 26)  # where a path is looked at
NOTHING = -1


def nearest(first: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """How far (N,) ways are free [m], at most 1, by what `steps_ahead` says of bodies; the index
    (N,) of the one that ends it, or `NOTHING`."""
    what = first.argmin(axis=1)
    steps = np.take_along_axis(first, what[:, None], axis=1)[:, 0]
    return steps * STEP_M, np.where(steps < len(AHEAD_M), what, NOTHING)


def _in_front(poses: np.ndarray, bodies: np.ndarray) -> np.ndarray:
    """(N, B) how far ahead bodies (N, B, 2) are along the robots' headings [m]."""
    x, y = np.moveaxis(bodies - poses[:, None, :2], -1, 0)
    return np.asarray(np.cos(poses[:, 2:]) * x + np.sin(poses[:, 2:]) * y)


def meeting(
    points: np.ndarray, poses: np.ndarray, body: np.ndarray, near_m: np.ndarray, free_m: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """How far (...,) exactly ways (..., K, 2), free for ``free_m`` as by `nearest`, lead until they
    are ``near_m`` from a body (..., 2); and their directions there (..., 2): in a bend somebody
    ahead goes elsewhere than who follows, and yet no slower."""
    k = np.minimum(np.rint(free_m / STEP_M).astype(int), points.shape[-2] - 1)[..., None, None]
    ways = np.concatenate((poses[..., None, :2], points), axis=-2)
    start, end = (np.take_along_axis(ways, at, -2)[..., 0, :] for at in (k, k + 1))
    step_m = np.maximum(np.hypot(*np.moveaxis(end - start, -1, 0)), 1e-9)
    way, off = (end - start) / step_m[..., None], body - start
    along_m = (off * way).sum(-1)
    more_m = along_m - np.sqrt(np.maximum(near_m**2 - (off**2).sum(-1) + along_m**2, 0.0))
    return free_m + np.clip(more_m, 0.0, STEP_M), way


def behind(poses: np.ndarray, bodies: np.ndarray) -> np.ndarray:
    """(N, B) bool: whether a body is behind a robot's axle."""
    return _in_front(poses, bodies) < 0.0
