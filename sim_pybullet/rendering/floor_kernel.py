"""The compiled loops that draw the floor: filtered texture reads for many robots at once."""

import math
from typing import Any, NamedTuple

import numpy as np
from numba import carray, njit, prange, types
from numba.extending import intrinsic

from sim_pybullet.rendering.rays import FloorTable

Points = tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]
LANES = np.uint64(0xFF | 0xFF << 24 | 0xFF << 44)  # red, blue, green with room for carries
HALF = np.uint64(128 | 128 << 24 | 128 << 44)


class FloorViews(NamedTuple):
    """What N robots look at."""

    # (N, 4) float64: column and row of the robot's origin [texels], cosine and sine of its heading
    placed: np.ndarray
    slots: np.ndarray  # (N,) their floor tables, which are one ``FloorTable`` of arrays (S, ...)
    addresses: np.ndarray  # (N,) of `mip_texture`
    levels: np.ndarray  # (N, L, 3) likewise


@intrinsic
def _as_texels(_context: Any, _address: Any) -> Any:
    """An address as a pointer to uint32, so that one call reads textures of many sizes."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return builder.inttoptr(arguments[0], context.get_value_type(signature.return_type))

    return types.CPointer(types.uint32)(types.int64), generate


class _Row(NamedTuple):
    """Scratch for one row of pixels: which texel, where in it (8 + 8 bits), colours so far."""

    texel: np.ndarray
    within: np.ndarray
    sums: np.ndarray


@njit(parallel=True, nogil=True, cache=True, fastmath=True, error_model="numpy")
def draw_floor(
    pictures: np.ndarray, skies: np.ndarray, views: FloorViews, tables: FloorTable, blocks: int
) -> None:
    """Fill pictures (N, 3 P) uint8 with floor and, where no run covers, with skies (N, 3 P).

    ``blocks``: into how many bands of rows each picture is cut, to be drawn in parallel.
    """
    height = tables.first_run.shape[1] - 1
    for task in prange(len(pictures) * blocks):
        i, block = np.int64(task) // blocks, np.int64(task) % blocks
        first, last = height * block // blocks, height * (block + 1) // blocks
        _draw_rows(pictures[i], skies[i], views, tables, i, first, last)


@njit(cache=True)
def _draw_rows(
    picture: np.ndarray,
    sky: np.ndarray,
    views: FloorViews,
    tables: FloorTable,
    i: np.int64,
    first_row: int,
    last_row: int,
) -> None:
    slot, levels = views.slots[i], views.levels[i]
    texels = carray(_as_texels(views.addresses[i]), levels[-1, 0] + levels[-1, 1] * levels[-1, 2])  # type: ignore[call-arg]
    width = len(picture) // (3 * (tables.first_run.shape[1] - 1))
    row = _Row(np.empty(width, np.uint32), np.empty(width, np.uint32), np.empty(width, np.uint64))
    table = tables.points[slot]  # slices of its rows are contiguous, or this is half as fast
    x, y, dx, dy = table[0], table[1], table[2], table[3]
    done = 3 * first_row * width
    for run in range(tables.first_run[slot, first_row], tables.first_run[slot, last_row]):
        first, last, level, log_taps = tables.runs[slot, run]
        _copy(sky[done : 3 * first], picture[done : 3 * first])
        done = 3 * last
        points = (x[first:last], y[first:last], dx[first:last], dy[first:last])
        offset, stride = levels[level, 0], levels[level, 1]
        row.sums[: last - first] = HALF << np.uint64(log_taps)
        for tap in range(1 << log_taps):
            _find_texels(row, points, np.float32(tap), views.placed[i], level, levels[level])
            _add_texels(row, texels[offset:], np.uint64(stride), last - first)
        _store(picture[3 * first : done], row.sums, np.uint64(8 + log_taps))
    _copy(sky[done : 3 * last_row * width], picture[done : 3 * last_row * width])


@njit(cache=True)
def _copy(source: np.ndarray, target: np.ndarray) -> None:
    for k in range(len(source)):  # a slice assignment does not become SIMD code
        target[k] = source[k]


@njit(cache=True, fastmath=True, error_model="numpy")
def _find_texels(
    row: _Row, points: Points, tap: np.float32, pose: np.ndarray, level: int, shape: np.ndarray
) -> None:
    """Fixed-point positions of one tap, kept within the level's border; this becomes SIMD code."""
    scale = 256.0 / (1 << level)
    column0 = np.float32(pose[0] * scale + 128.0)  # texel centres lie at halves; border: one
    row0 = np.float32(pose[1] * scale + 128.0)
    c, s = np.float32(256.0 * pose[2]), np.float32(256.0 * pose[3])
    zero, fraction, eight = np.float32(0.0), np.uint32(255), np.uint32(8)
    right = np.float32((shape[1] - 1) * 256 - 1)
    bottom = np.float32((shape[2] - 1) * 256 - 1)
    stride = np.uint32(shape[1])
    x, y, dx, dy = points
    for k in range(len(x)):
        ahead, left = x[k] + tap * dx[k], y[k] + tap * dy[k]
        u = np.uint32(np.int32(min(max(c * ahead - s * left + column0, zero), right)))
        v = np.uint32(np.int32(min(max(row0 - s * ahead - c * left, zero), bottom)))
        row.texel[k] = (v >> eight) * stride + (u >> eight)
        row.within[k] = (u & fraction) | (v & fraction) << eight


@njit(cache=True)
def _add_texels(row: _Row, texels: np.ndarray, stride: np.uint64, count: int) -> None:
    """Bilinear: four texels around each position, weighted to a sum of 256."""
    one, eight, fraction = np.uint64(1), np.uint64(8), np.uint64(255)
    for k in range(count):
        above, within = np.uint64(row.texel[k]), np.uint64(row.within[k])
        below = above + stride
        fx, fy = within & fraction, within >> eight
        both = (fx * fy + np.uint64(128)) >> eight
        total = _spread(texels[above]) * (np.uint64(256) - fx - fy + both)
        total += _spread(texels[above + one]) * (fx - both)
        total += _spread(texels[below]) * (fy - both)
        row.sums[k] += total + _spread(texels[below + one]) * both


@njit(inline="always")
def _spread(texel: np.uint32) -> np.uint64:
    wide = np.uint64(texel)
    return (wide | wide << np.uint64(32)) & LANES


@njit(cache=True)
def _store(picture: np.ndarray, sums: np.ndarray, shift: np.uint64) -> None:
    byte, green, blue = np.uint64(255), np.uint64(44), np.uint64(24)
    for k in range(len(picture) // 3):
        total = sums[k] >> shift
        picture[3 * k] = np.uint8(total & byte)
        picture[3 * k + 1] = np.uint8((total >> green) & byte)
        picture[3 * k + 2] = np.uint8((total >> blue) & byte)


@njit(parallel=True, nogil=True, cache=True, fastmath=True, error_model="numpy")
def label_floor(labels: np.ndarray, views: FloorViews, tables: FloorTable) -> None:
    """Fill labels (N, P) uint8 with the class that each pixel's ray meets."""
    points, runs, first_run = tables
    placed, slots, addresses, levels = views
    for i in prange(len(labels)):
        slot = slots[i]
        x, y, dx, dy = points[slot]
        wide, high = levels[i, 0, 1], levels[i, 0, 2]
        texels = carray(_as_texels(addresses[i]), wide * high)  # type: ignore[call-arg]
        column0, row0, c, s = placed[i]
        for run in range(first_run[slot, -1]):
            first, last, level, log_taps = runs[slot, run]
            middle = 0.5 * ((1 << log_taps) - 1)
            scale = float(1 << level)
            for p in range(first, last):
                px = (x[p] + middle * dx[p]) * scale
                py = (y[p] + middle * dy[p]) * scale
                u = min(max(c * px - s * py + column0 + 1.0, 0.0), wide - 1.0)
                v = min(max(row0 - s * px - c * py + 1.0, 0.0), high - 1.0)
                texel = texels[np.int64(math.floor(v)) * wide + np.int64(math.floor(u))]
                labels[i, p] = np.uint8((texel >> np.uint32(8)) & np.uint32(15))
