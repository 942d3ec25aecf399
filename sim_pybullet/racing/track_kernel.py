"""The compiled loops that find the centre line from each texel and lay the track's colours."""

from __future__ import annotations

import math

import numpy as np
from numba import njit, prange

from sim_pybullet.classes import SemanticClass

BLOCK = 32  # texels on a side that search together
FAR = np.float32(1e9)  # offset of texels that are nowhere near the track
_OUTSIDE, _ROAD = int(SemanticClass.OUTSIDE), int(SemanticClass.ROAD)
_WHITE, _YELLOW = int(SemanticClass.WHITE_LINE), int(SemanticClass.YELLOW_LINE)
_KERB = int(SemanticClass.KERB)
# Rows of the colours
ROAD, GRASS, OUTSIDE, KERB, KERB_2, WHITE, YELLOW = range(7)


@njit(parallel=True, nogil=True, cache=True, fastmath=True)
def locate(
    points: np.ndarray, shape: tuple[int, int], north: float, texel: float, reach: float
) -> tuple[np.ndarray, np.ndarray]:
    """Offset from the centre line and arc length of each texel, both (H, W) float32.

    Args:
        points: (M, 4) x, y, heading and arc length of the centre line, evenly spaced.
        shape: (H, W); row 0 is at the north edge, column 0 at x = 0.
        north, texel: y of the north edge and size of a texel.
        reach: beyond this distance the offset is FAR.
    """
    height, width = shape
    offset, arc = np.full(shape, FAR, np.float32), np.zeros(shape, np.float32)
    rows, columns = (height + BLOCK - 1) // BLOCK, (width + BLOCK - 1) // BLOCK
    wide = reach + 0.75 * BLOCK * texel
    for block in prange(rows * columns):
        top, left = int(block) // columns * BLOCK, int(block) % columns * BLOCK
        x0, y0 = (left + 0.5 * BLOCK) * texel, north - (top + 0.5 * BLOCK) * texel
        near = np.flatnonzero((points[:, 0] - x0) ** 2 + (points[:, 1] - y0) ** 2 < wide * wide)
        if len(near) == 0:
            continue
        for v in range(top, min(top + BLOCK, height)):
            for u in range(left, min(left + BLOCK, width)):
                x, y = (u + 0.5) * texel, north - (v + 0.5) * texel
                best, found = reach * reach, -1
                for j in range(len(near)):
                    k = int(near[j])
                    square = (points[k, 0] - x) ** 2 + (points[k, 1] - y) ** 2
                    if square < best:
                        best, found = square, k
                if found >= 0:
                    dx, dy = x - points[found, 0], y - points[found, 1]
                    c, s = math.cos(points[found, 2]), math.sin(points[found, 2])
                    offset[v, u] = c * dy - s * dx
                    arc[v, u] = points[found, 3] + c * dx + s * dy
    return offset, arc


@njit(cache=True, fastmath=True, inline="always")
def _band(x: float, low: float, high: float, texel: float) -> float:
    """How much of a texel around x lies between two borders."""
    inside = min(x + 0.5 * texel, high) - max(x - 0.5 * texel, low)
    return min(max(inside / texel, 0.0), 1.0)


@njit(parallel=True, nogil=True, cache=True, fastmath=True)
def lay(
    offset: np.ndarray,
    arc: np.ndarray,
    bends: np.ndarray,
    colours: np.ndarray,
    sizes: np.ndarray,
    grain: np.ndarray,
    kept: np.ndarray,
    brightness: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:
    """Colours (H, W, 3) uint8 and classes (H, W) uint8 of a track's ground.

    Args:
        offset, arc: (H, W) as of ``locate``.
        bends: (M,) bool, whether there are kerbs at the centre line's points.
        colours: (7, 3) float32, rows as named above.
        sizes: half width, verge, edge line, kerb, length of a kerb stone, centre line, its dashes'
            period, its opacity, point spacing, texel.
        grain, kept: (S, S) float32, S a power of two: noise [grey levels], share of paint left.
        brightness: (H, W) float32 factor, or (1, 1) for one everywhere.
    """
    half, verge, line, kerb, stone, middle, period, opacity, spacing, texel = sizes
    height, width = offset.shape
    rgb, classes = np.empty((height, width, 3), np.uint8), np.empty((height, width), np.uint8)
    mask = len(grain) - 1
    for v in prange(height):
        for u in range(width):
            away = abs(offset[v, u])
            light = brightness[v % len(brightness), u % brightness.shape[1]]
            noise, paint = grain[v & mask, u & mask], kept[v & mask, u & mask]
            base, kind, white, yellow = OUTSIDE, _OUTSIDE, 0.0, 0.0
            if away < half:
                base, kind = ROAD, _ROAD
                white = _band(away, half - 1.5 * line, half - 0.5 * line, texel)
                white = max(white, _band(arc[v, u], 0.0, 2.0 * line, texel))
                if arc[v, u] % period < 0.5 * period:
                    yellow = opacity * _band(away, -0.5 * middle, 0.5 * middle, texel)
            elif away < half + verge:
                base, noise = GRASS, 2.0 * noise
                index = min(max(int(arc[v, u] / spacing), 0), len(bends) - 1)
                if away < half + kerb and bends[index]:
                    base, kind = KERB + int(arc[v, u] / stone) % 2, _KERB
            if white * paint > 0.5:
                kind = _WHITE
            elif yellow * paint > 0.5:
                kind = _YELLOW
            classes[v, u] = kind
            white, yellow = white * paint, yellow * paint
            for c in range(3):
                value = colours[base, c] * (1.0 - white) + colours[WHITE, c] * white
                value = value * (1.0 - yellow) + colours[YELLOW, c] * yellow
                rgb[v, u, c] = np.uint8(min(max((value + noise) * light + 0.5, 0.0), 255.0))
    return rgb, classes
