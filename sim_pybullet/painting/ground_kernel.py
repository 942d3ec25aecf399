"""The compiled loop that lays asphalt, joints, paint and wear over each other."""

from __future__ import annotations

import numpy as np
from numba import njit, prange


@njit(parallel=True, nogil=True, cache=True, fastmath=True)
def compose(
    index: np.ndarray,
    paints: np.ndarray,
    bases: np.ndarray,
    colours: np.ndarray,
    seam: np.ndarray,
    has_seam: np.ndarray,
    grain: np.ndarray,
    kept: np.ndarray,
    brightness: np.ndarray,
) -> np.ndarray:
    """The floor as (rows * T, columns * T, 3) uint8 RGB.

    Args:
        index: (rows, columns) integers, which of the K tile pictures lies where.
        paints: (K, T, T, 3) uint8 coverage of the three paints.
        bases, colours: (K, 3) and (3, 3) float32, ground of each tile and colour of each paint.
        seam, has_seam: (T, T) darkening at the joints [grey levels] and (K,) its share.
        grain, kept: (S, S) float32, S a power of two: noise [grey levels], share of paint left.
        brightness: (rows * T, columns * T) float32 factor.
    """
    size = paints.shape[1]
    mask = grain.shape[0] - 1
    height, width = brightness.shape
    rgb = np.empty((height, width, 3), np.uint8)
    for row in prange(height):
        v = row % size
        for column in range(width):
            u = column % size
            tile = index[row // size, column // size]
            noise = grain[row & mask, column & mask] - seam[v, u] * has_seam[tile]
            left = kept[row & mask, column & mask] / np.float32(255.0)
            white = paints[tile, v, u, 0] * left
            yellow = paints[tile, v, u, 1] * left
            red = paints[tile, v, u, 2] * left
            bare = np.float32(1.0) - white - yellow - red
            noise *= np.float32(0.4) + np.float32(0.6) * bare  # tape is smoother than foam
            for c in range(3):
                paint = white * colours[0, c] + yellow * colours[1, c] + red * colours[2, c]
                value = bare * bases[tile, c] + paint + noise
                value = value * brightness[row, column] + np.float32(0.5)
                rgb[row, column, c] = np.uint8(min(max(value, np.float32(0.0)), np.float32(255.0)))
    return rgb
