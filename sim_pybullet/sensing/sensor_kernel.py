"""The compiled loops of the sensor, over frames as (N, H, 3 W) uint8."""

from __future__ import annotations

import numpy as np
from numba import njit, prange


@njit(parallel=True, nogil=True, cache=True, fastmath=True)
def expose(
    frames: np.ndarray,
    gains: np.ndarray,
    vignettings: np.ndarray,
    rows: np.ndarray,
    columns: np.ndarray,
    noise: np.ndarray,
    starts: np.ndarray,
    table: np.ndarray,
) -> np.ndarray:
    """Frames times (1 - vignetting r^2) times gain plus noise.

    Args:
        gains: (N, 3 W) float32.
        vignettings, noise: (N,) float32.
        rows, columns: (H,) and (3 W,) float32, their shares of r^2.
        starts: (N, H) where in the noise ``table`` each row begins.
    """
    exposed = np.empty_like(frames)
    low, half, high = np.float32(0.0), np.float32(0.5), np.float32(255.0)
    for i in prange(len(frames)):
        for v in range(frames.shape[1]):
            grain = table[starts[i, v] : starts[i, v] + frames.shape[2]]
            middle = np.float32(1.0) - vignettings[i] * rows[v]
            for k in range(frames.shape[2]):
                shade = (middle - vignettings[i] * columns[k]) * gains[i, k]
                value = np.float32(frames[i, v, k]) * shade + noise[i] * grain[k] + half
                exposed[i, v, k] = np.uint8(np.int32(min(max(value, low), high)))
    return exposed


@njit(parallel=True, nogil=True, cache=True, fastmath=True)
def blur(frames: np.ndarray, kernels: np.ndarray) -> np.ndarray:
    """Frames convolved in both directions with (N, 2 R + 1) float32 kernels; edges repeat."""
    height, width = frames.shape[1:]
    radius = kernels.shape[1] // 2
    pad = 3 * radius
    blurred = np.empty_like(frames)
    for i in prange(len(frames)):
        line = np.empty(width + 2 * pad, np.float32)
        total = np.empty(width, np.float32)
        for v in range(height):
            _blur_row(frames[i], kernels[i], v, line, total)
            for k in range(width):
                blurred[i, v, k] = np.uint8(np.int32(total[k]))
    return blurred


@njit(fastmath=True)
def _blur_row(
    frame: np.ndarray, kernel: np.ndarray, v: int, line: np.ndarray, total: np.ndarray
) -> None:
    height, width = frame.shape
    radius = len(kernel) // 2
    pad = 3 * radius
    line[:] = np.float32(0.0)
    for j in range(len(kernel)):
        source = frame[min(max(v + j - radius, 0), height - 1)]
        for k in range(width):
            line[pad + k] += kernel[j] * np.float32(source[k])
    for k in range(pad):
        line[k] = line[pad + k % 3]
        line[pad + width + k] = line[pad + width - 3 + k % 3]
    total[:] = np.float32(0.5)
    for j in range(len(kernel)):
        shifted = line[3 * j : 3 * j + width]
        for k in range(width):
            total[k] += kernel[j] * shifted[k]
