"""The compiled loops of the sensor, over pictures as (H, 3 W) uint8."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numba import njit, prange, types
from numba.extending import intrinsic

from sim_pybullet.sensing.jpeg_kernel import through_jpeg


class SensorTable(NamedTuple):
    """What N sensors do; a stage that changes nothing is left out.

    ``blur`` (N, 2 R + 1) float32, ``infrared`` (N, 3, 3) in 1024ths, ``gains`` (N, 3) float32,
    ``vignetting`` and ``noise`` (N,) float32, ``steps`` (N, 2, 2, 256) of the JPEG; ``stages``
    (N, 4) bool says which of blur, infrared, exposure and JPEG there are.
    """

    blur: np.ndarray
    infrared: np.ndarray
    gains: np.ndarray
    vignetting: np.ndarray
    noise: np.ndarray
    steps: np.ndarray
    stages: np.ndarray


class Grain(NamedTuple):
    """Where noise comes from: ``starts`` (M, H) of each row in the ``table``; and the ``rows`` (H,)
    and ``columns`` (3 W,) float32 of r^2, of which the vignette is made."""

    starts: np.ndarray
    table: np.ndarray
    rows: np.ndarray
    columns: np.ndarray


def _fused(_context: Any, _a: Any, _b: Any, _c: Any) -> Any:
    """a b + c with one rounding, on every processor."""

    def generate(_: Any, builder: Any, __: Any, arguments: Any) -> Any:
        return builder.fma(*arguments)

    return types.float32(types.float32, types.float32, types.float32), generate


fma: Any = intrinsic(_fused)


@njit(parallel=True, nogil=True, cache=True)
def sense(frames: np.ndarray, robots: np.ndarray, sensors: SensorTable, grain: Grain) -> None:
    """What the sensors of robots (M,) make of their frames (M, H, 3 W), in place."""
    for m in prange(len(frames)):
        i, frame = robots[m], frames[m]
        blurs, reddens, exposes, compresses = sensors.stages[i]
        if blurs:
            blur(frame, sensors.blur[i])
        if reddens:
            mix(frame, sensors.infrared[i])
        if exposes:
            shade = sensors.vignetting[i], sensors.noise[i]
            expose(frame, sensors.gains[i], shade, grain.starts[m], grain)
        if compresses:
            through_jpeg(frame, sensors.steps[i])


@njit(cache=True)
def mix(frame: np.ndarray, shares: np.ndarray) -> None:
    """Colours as sums of their shares (3, 3) of 1024 in red, green and blue."""
    for v in range(len(frame)):
        row = frame[v]
        for k in range(0, len(row), 3):
            red, green, blue = np.int32(row[k]), np.int32(row[k + 1]), np.int32(row[k + 2])
            for c in range(3):
                total = shares[c, 0] * red + shares[c, 1] * green + shares[c, 2] * blue
                row[k + c] = min(max((total + 512) >> 10, 0), 255)


@njit(cache=True)
def expose(
    frame: np.ndarray,
    gains: np.ndarray,
    shade: tuple[np.float32, np.float32],
    starts: np.ndarray,
    grain: Grain,
) -> None:
    """A frame times (1 - vignetting r^2) times gain plus noise; ``shade``: vignetting and noise."""
    low, half, high = np.float32(0.0), np.float32(0.5), np.float32(255.0)
    vignetting, noise = shade
    width, columns = frame.shape[1], grain.columns
    each = np.empty(width, np.float32)
    for k in range(width):
        each[k] = gains[k % 3]
    for v in range(len(frame)):
        row, noisy = frame[v], grain.table[starts[v] : starts[v] + width]
        middle = np.float32(1.0) - vignetting * grain.rows[v]
        for k in range(width):
            light = fma(-vignetting, columns[k], middle) * each[k]
            value = fma(noise, noisy[k], fma(np.float32(row[k]), light, half))
            row[k] = np.uint8(np.int32(min(max(value, low), high)))


@njit(cache=True, fastmath=True)
def blur(frame: np.ndarray, kernel: np.ndarray) -> None:
    """A frame convolved in both directions with a kernel (2 R + 1,); edges repeat."""
    height, width = frame.shape
    radius = len(kernel) // 2
    pad = 3 * radius
    before = frame.copy()
    line = np.empty(width + 2 * pad, np.float32)
    total = np.empty(width, np.float32)
    for v in range(height):
        line[:] = np.float32(0.0)
        for j in range(len(kernel)):
            source = before[min(max(v + j - radius, 0), height - 1)]
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
        for k in range(width):
            frame[v, k] = np.uint8(np.int32(total[k]))
