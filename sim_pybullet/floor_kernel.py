"""The compiled loops that draw the floor: filtered texture reads for many robots at once."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numba import carray, njit, prange, types
from numba.extending import intrinsic

LANES = np.uint64(0xFF | 0xFF << 24 | 0xFF << 44)  # red, blue, green with room for carries
HALF = np.uint64(128 | 128 << 24 | 128 << 44)


class FloorTables(NamedTuple):
    """The ``FloorTable`` of every slot: (S, P) float32, runs (S, R, 4), first_run (S, H + 1)."""

    x: np.ndarray
    y: np.ndarray
    dx: np.ndarray
    dy: np.ndarray
    runs: np.ndarray
    first_run: np.ndarray


class FloorViews(NamedTuple):
    """What N robots look at.

    ``placed`` (N, 4) float64 is where they stand in the texture: column and row of the robot's
    origin [texels], cosine and sine of its heading. ``slots`` (N,) names their floor tables,
    ``addresses`` (N,) and ``levels`` (N, L, 3) their ``MipTexture``.
    """

    placed: np.ndarray
    slots: np.ndarray
    addresses: np.ndarray
    levels: np.ndarray


@intrinsic
def _as_texels(_context: Any, _address: Any) -> Any:
    """An address as a pointer to uint32, so that one call reads textures of many sizes."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return builder.inttoptr(arguments[0], context.get_value_type(signature.return_type))

    return types.CPointer(types.uint32)(types.int64), generate


@njit(inline="always")
def _sample(texels: np.ndarray, stride: np.int64, column: np.int64, row: np.int64) -> np.uint64:
    """Four texels around a fixed-point position (8 fractional bits), weighted to a sum of 256."""
    i = np.uint64((row >> 8) * stride + (column >> 8))
    fx, fy = column & 255, row & 255
    both = (fx * fy + 128) >> 8
    below = i + np.uint64(stride)
    total = _spread(texels[i]) * np.uint64(256 - fx - fy + both)
    total += _spread(texels[i + np.uint64(1)]) * np.uint64(fx - both)
    total += _spread(texels[below]) * np.uint64(fy - both)
    return total + _spread(texels[below + np.uint64(1)]) * np.uint64(both)


@njit(inline="always")
def _spread(texel: np.uint32) -> np.uint64:
    wide = np.uint64(texel)
    return (wide | wide << np.uint64(32)) & LANES


@njit(inline="always")
def _store(picture: np.ndarray, pixel: int, total: np.uint64, shift: np.uint64) -> None:
    picture[pixel, 0] = np.uint8((total >> shift) & np.uint64(255))
    picture[pixel, 1] = np.uint8((total >> (shift + np.uint64(44))) & np.uint64(255))
    picture[pixel, 2] = np.uint8((total >> (shift + np.uint64(24))) & np.uint64(255))


@njit(parallel=True, nogil=True, cache=True, fastmath=True, error_model="numpy")
def draw_floor(
    pictures: np.ndarray,
    skies: np.ndarray,
    views: FloorViews,
    tables: FloorTables,
    blocks: int,
) -> None:
    """Fill pictures (N, P, 3) uint8 with floor and, where no run covers, with skies (N, P, 3).

    ``blocks``: into how many bands of rows each picture is cut, to be drawn in parallel.
    """
    x, y, dx, dy, runs, first_run = tables
    placed, slots, addresses, levels = views
    height = first_run.shape[1] - 1
    width = pictures.shape[1] // height
    for task in prange(len(pictures) * blocks):
        i, block = task // blocks, task % blocks
        slot = slots[i]
        texels = carray(_as_texels(addresses[i]), levels[i, -1, 0] + levels[i, -1, 1])  # type: ignore[call-arg]
        for row in range(height * block // blocks, height * (block + 1) // blocks):
            pixel = row * width
            for run in range(first_run[slot, row], first_run[slot, row + 1]):
                first, last, level, log_taps = runs[slot, run]
                _copy(pictures[i], skies[i], pixel, first)
                _draw_run(
                    pictures[i],
                    texels,
                    levels[i, level],
                    placed[i],
                    level,
                    log_taps,
                    first,
                    last,
                    x[slot],
                    y[slot],
                    dx[slot],
                    dy[slot],
                )
                pixel = last
            _copy(pictures[i], skies[i], pixel, (row + 1) * width)


@njit(inline="always")
def _copy(picture: np.ndarray, sky: np.ndarray, first: int, last: int) -> None:
    for p in range(first, last):
        picture[p, 0] = sky[p, 0]
        picture[p, 1] = sky[p, 1]
        picture[p, 2] = sky[p, 2]


@njit(inline="always")
def _draw_run(
    picture: np.ndarray,
    texels: np.ndarray,
    shape: np.ndarray,
    pose: np.ndarray,
    level: int,
    log_taps: int,
    first: int,
    last: int,
    x: np.ndarray,
    y: np.ndarray,
    dx: np.ndarray,
    dy: np.ndarray,
) -> None:
    scale = 256.0 / (1 << level)
    column0 = np.float32(pose[0] * scale + 128.0)  # texel centres lie at halves; border: one
    row0 = np.float32(pose[1] * scale + 128.0)
    c, s = np.float32(256.0 * pose[2]), np.float32(256.0 * pose[3])
    zero, half = np.float32(0.0), HALF
    right = np.float32((shape[1] - 1) * 256 - 1)
    bottom = np.float32((shape[2] - 1) * 256 - 1)
    stride = np.int64(shape[1])
    level_texels = texels[shape[0] :]
    if log_taps == 0:
        for p in range(first, last):
            u = min(max(c * x[p] - s * y[p] + column0, zero), right)
            v = min(max(row0 - s * x[p] - c * y[p], zero), bottom)
            total = _sample(level_texels, stride, np.int64(np.int32(u)), np.int64(np.int32(v)))
            _store(picture, p, total + half, np.uint64(8))
        return
    taps, shift = 1 << log_taps, np.uint64(8 + log_taps)
    half <<= np.uint64(log_taps)
    for p in range(first, last):
        total = half
        for k in range(taps):
            px = x[p] + np.float32(k) * dx[p]
            py = y[p] + np.float32(k) * dy[p]
            u = min(max(c * px - s * py + column0, zero), right)
            v = min(max(row0 - s * px - c * py, zero), bottom)
            total += _sample(level_texels, stride, np.int64(np.int32(u)), np.int64(np.int32(v)))
        _store(picture, p, total, shift)


@njit(parallel=True, nogil=True, cache=True, fastmath=True, error_model="numpy")
def label_floor(labels: np.ndarray, views: FloorViews, tables: FloorTables) -> None:
    """Fill labels (N, P) uint8 with the class that each pixel's ray meets."""
    x, y, dx, dy, runs, first_run = tables
    placed, slots, addresses, levels = views
    for i in prange(len(labels)):
        slot = slots[i]
        wide, high = levels[i, 0, 1], levels[i, 0, 2]
        texels = carray(_as_texels(addresses[i]), wide * high)  # type: ignore[call-arg]
        column0, row0, c, s = placed[i]
        for run in range(first_run[slot, -1]):
            first, last, level, log_taps = runs[slot, run]
            middle = 0.5 * ((1 << log_taps) - 1)
            scale = float(1 << level)
            for p in range(first, last):
                px = (x[slot, p] + middle * dx[slot, p]) * scale
                py = (y[slot, p] + middle * dy[slot, p]) * scale
                u = min(max(c * px - s * py + column0 + 1.0, 0.0), wide - 1.0)
                v = min(max(row0 - s * px - c * py + 1.0, 0.0), high - 1.0)
                texel = texels[np.int64(math.floor(v)) * wide + np.int64(math.floor(u))]
                labels[i, p] = np.uint8((texel >> np.uint32(8)) & np.uint32(15))
