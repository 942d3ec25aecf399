"""What JPEG leaves of a picture, without writing one: libjpeg's arithmetic between its coders.

Huffman coding loses nothing, so the picture that comes back depends on colour conversion, chroma at
half size, cosine transform and quantisation alone. All of it is whole numbers, libjpeg's to the
last bit (jccolor, jcsample, jfdctint, jcdctmgr, jidctint, jdsample, jdcolor of libjpeg 6b, 1998):
baseline, 4:2:0, accurate transform, fancy upsampling, which is what OpenCV writes and reads.
"""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np
from numba import njit

_SIDE = 16  # pixels of a square that is transformed at once: four blocks, sixteen numbers abreast
_LUMA = """16 11 10 16 24 40 51 61 12 12 14 19 26 58 60 55 14 13 16 24 40 57 69 56 14 17 22 29 51 87
80 62 18 22 37 56 68 109 103 77 24 35 55 64 81 104 113 92 49 64 78 87 103 121 120 101 72 92 95 98
112 100 103 99"""  # ITU T.81, table K.1
_CHROMA = f"""17 18 24 47 {"99 " * 4} 18 21 26 66 {"99 " * 4} 24 26 56 {"99 " * 5} 47 66 {"99 " * 6}
{"99 " * 32}"""  # table K.2


@lru_cache(maxsize=100)
def quantisers(quality: int) -> np.ndarray:
    """(2, 2, 256): of luma and of chroma, the steps over a square and one eighth of 1 / steps."""
    scale = 5000 // quality if quality < 50 else 200 - 2 * quality
    tables = np.array([_LUMA.split(), _CHROMA.split()], np.int32).reshape(2, 8, 8)
    steps = np.clip((tables * scale + 50) // 100, 1, 255)
    square = np.tile(steps, (1, 2, 2)).reshape(2, _SIDE * _SIDE).astype(np.float64)
    return np.stack((square, 0.125 / square), axis=1)


@njit(cache=True)
def through_jpeg(picture: np.ndarray, steps: np.ndarray) -> None:
    """Leave in a picture (H, 3 W) uint8 RGB what JPEG with these ``quantisers`` would leave of it.

    H and W are at least 8.
    """
    height, width = picture.shape[0], picture.shape[1] // 3
    rows, columns = (height + 1) // 2, (width + 1) // 2  # of the chroma
    room = (-(-rows // _SIDE) * _SIDE, -(-columns // _SIDE) * _SIDE)
    full = np.empty((3, 2 * room[0], 2 * room[1]), np.float32)
    half = np.empty((2, *room), np.float32)
    for v in range(height):
        _to_ycc(picture[v], full[0, v], full[1, v], full[2, v])
    for k in range(3):
        _repeat_edges(full[k], height, width)
    _through_blocks(full[0], height, width, steps[0])
    for k in range(2):
        _halve(full[k + 1], half[k])
        _repeat_edges(half[k], rows, room[1])
        _through_blocks(half[k], rows, columns, steps[1])
        _double(half[k, :rows, :columns], full[k + 1])
    for v in range(height):
        _to_rgb(full[0, v], full[1, v], full[2, v], picture[v])


@njit(cache=True)
def _repeat_edges(plane: np.ndarray, height: int, width: int) -> None:
    for v in range(height):
        plane[v, width:] = plane[v, width - 1]
    for v in range(height, len(plane)):
        plane[v] = plane[height - 1]


@njit(cache=True)
def _to_ycc(rgb: np.ndarray, luma: np.ndarray, blue: np.ndarray, red: np.ndarray) -> None:
    """A row (3 W,) uint8 as three rows (>= W,) float64 of whole numbers."""
    for u in range(len(rgb) // 3):
        r, g, b = float(rgb[3 * u]), float(rgb[3 * u + 1]), float(rgb[3 * u + 2])
        luma[u] = np.floor((19595.0 * r + 38470.0 * g + 7471.0 * b + 32768.0) / 65536.0)
        blue[u] = np.floor((-11059.0 * r - 21709.0 * g + 32768.0 * b + 8421375.0) / 65536.0)
        red[u] = np.floor((32768.0 * r - 27439.0 * g - 5329.0 * b + 8421375.0) / 65536.0)


@njit(cache=True)
def _to_rgb(luma: np.ndarray, blue: np.ndarray, red: np.ndarray, rgb: np.ndarray) -> None:
    for u in range(len(rgb) // 3):
        y, cb, cr = luma[u], blue[u] - 128.0, red[u] - 128.0
        r = y + np.floor((91881.0 * cr + 32768.0) / 65536.0)
        g = y + np.floor((-22554.0 * cb - 46802.0 * cr + 32768.0) / 65536.0)
        b = y + np.floor((116130.0 * cb + 32768.0) / 65536.0)
        rgb[3 * u] = np.int32(min(max(r, 0.0), 255.0))
        rgb[3 * u + 1] = np.int32(min(max(g, 0.0), 255.0))
        rgb[3 * u + 2] = np.int32(min(max(b, 0.0), 255.0))


@njit(cache=True)
def _halve(full: np.ndarray, half: np.ndarray) -> None:
    """Means of squares of four, rounded up and down in turn."""
    one, quarter = np.float32(1.0), np.float32(0.25)
    for v in range(half.shape[0]):
        above, below, target = full[2 * v], full[2 * v + 1], half[v]
        for u in range(len(target)):
            total = above[2 * u] + above[2 * u + 1] + below[2 * u] + below[2 * u + 1]
            target[u] = np.floor((total + one + np.float32(u & 1)) * quarter)


@njit(cache=True)
def _double(half: np.ndarray, full: np.ndarray) -> None:
    """Triangle filter: each pixel takes three quarters of the nearer one in both directions."""
    rows, columns = half.shape
    sums = np.empty(columns + 2)
    for v in range(2 * rows):
        nearer, target = half[v // 2], full[v]
        other = half[min(v // 2 + 1, rows - 1) if v & 1 else max(v // 2 - 1, 0)]
        for u in range(columns):
            sums[u + 1] = 3.0 * nearer[u] + other[u]
        sums[0], sums[columns + 1] = sums[1], sums[columns]
        for u in range(columns):
            target[2 * u] = np.floor((3.0 * sums[u + 1] + sums[u] + 8.0) / 16.0)
            target[2 * u + 1] = np.floor((3.0 * sums[u + 1] + sums[u + 2] + 7.0) / 16.0)


@njit(cache=True)
def _through_blocks(plane: np.ndarray, height: int, width: int, steps: np.ndarray) -> None:
    """Transform, quantise and transform back what of a plane is in use, a square at a time.

    The transform's whole numbers are kept as float64, which holds them exactly: there are registers
    for eight products at once.
    """
    square, turned = np.empty(_SIDE * _SIDE), np.empty(_SIDE * _SIDE)
    for top in range(0, height, _SIDE):
        for left in range(0, width, _SIDE):
            for r in range(_SIDE):
                row = plane[top + r, left : left + _SIDE]
                for c in range(_SIDE):
                    square[_SIDE * c + r] = row[c] - 128.0
            for half in range(0, _SIDE, 8):
                _forward(square, half, 2.0**-11)
            _turn(square, turned)
            for half in range(0, _SIDE, 8):
                _forward(turned, half, 2.0**-15)
            _quantise(turned, steps)
            for half in range(0, _SIDE, 8):
                _back(turned, half, 2.0**-11)
            _turn(turned, square)
            for half in range(0, _SIDE, 8):
                _back(square, half, 2.0**-18)
            for r in range(_SIDE):
                row = plane[top + r, left : left + _SIDE]
                for c in range(_SIDE):
                    row[c] = min(max(square[_SIDE * c + r] + 128.0, 0.0), 255.0)


@njit(cache=True)
def _turn(square: np.ndarray, turned: np.ndarray) -> None:
    for r in range(_SIDE):
        for c in range(_SIDE):
            turned[_SIDE * r + c] = square[_SIDE * c + r]


@njit(cache=True)
def _quantise(square: np.ndarray, steps: np.ndarray) -> None:
    """Coefficients, eight times as large as JPEG's, to the nearest multiples of their steps."""
    for k in range(_SIDE * _SIDE):
        # the half keeps quotients off whole numbers, where rounding could go either way
        size = np.floor((abs(square[k]) + (4.0 * steps[0, k] + 0.5)) * steps[1, k])
        square[k] = math.copysign(size * steps[0, k], square[k])


@njit(cache=True)
def _forward(x: np.ndarray, first: int, scale: float) -> None:
    """The cosine transform of eight rows of sixteen columns, from row ``first`` on (jfdctint.c)."""
    x = x[_SIDE * first : _SIDE * (first + 8)]
    for k in range(_SIDE):
        a, b, c, d = x[k], x[k + 16], x[k + 32], x[k + 48]
        e, f, g, h = x[k + 64], x[k + 80], x[k + 96], x[k + 112]
        t0, t1, t2, t3 = a + h, b + g, c + f, d + e
        t7, t6, t5, t4 = a - h, b - g, c - f, d - e
        u0, u3, u1, u2 = t0 + t3, t0 - t3, t1 + t2, t1 - t2
        z = (u2 + u3) * 4433.0
        z1, z2, z3, z4 = t4 + t7, t5 + t6, t4 + t6, t5 + t7
        z5 = (z3 + z4) * 9633.0
        z1, z2 = z1 * -7373.0, z2 * -20995.0
        z3, z4 = z3 * -16069.0 + z5, z4 * -3196.0 + z5
        x[k] = np.floor((u0 + u1) * (8192.0 * scale) + 0.5)
        x[k + 16] = np.floor((t7 * 12299.0 + z1 + z4) * scale + 0.5)
        x[k + 32] = np.floor((z + u3 * 6270.0) * scale + 0.5)
        x[k + 48] = np.floor((t6 * 25172.0 + z2 + z3) * scale + 0.5)
        x[k + 64] = np.floor((u0 - u1) * (8192.0 * scale) + 0.5)
        x[k + 80] = np.floor((t5 * 16819.0 + z2 + z4) * scale + 0.5)
        x[k + 96] = np.floor((z + u2 * -15137.0) * scale + 0.5)
        x[k + 112] = np.floor((t4 * 2446.0 + z1 + z3) * scale + 0.5)


@njit(cache=True)
def _back(x: np.ndarray, first: int, scale: float) -> None:
    """The transform back of eight rows of sixteen columns, from row ``first`` on (jidctint.c)."""
    x = x[_SIDE * first : _SIDE * (first + 8)]
    for k in range(_SIDE):
        a, b, c, d = x[k], x[k + 16], x[k + 32], x[k + 48]
        e, f, g, h = x[k + 64], x[k + 80], x[k + 96], x[k + 112]
        z = (c + g) * 4433.0
        t2, t3 = z - g * 15137.0, z + c * 6270.0
        t0, t1 = (a + e) * 8192.0, (a - e) * 8192.0
        u0, u3, u1, u2 = t0 + t3, t0 - t3, t1 + t2, t1 - t2
        z1, z2, z3, z4 = h + b, f + d, h + d, f + b
        z5 = (z3 + z4) * 9633.0
        z1, z2 = z1 * -7373.0, z2 * -20995.0
        z3, z4 = z3 * -16069.0 + z5, z4 * -3196.0 + z5
        t0, t1 = h * 2446.0 + z1 + z3, f * 16819.0 + z2 + z4
        t2, t3 = d * 25172.0 + z2 + z3, b * 12299.0 + z1 + z4
        x[k] = np.floor((u0 + t3) * scale + 0.5)
        x[k + 16] = np.floor((u1 + t2) * scale + 0.5)
        x[k + 32] = np.floor((u2 + t1) * scale + 0.5)
        x[k + 48] = np.floor((u3 + t0) * scale + 0.5)
        x[k + 64] = np.floor((u3 - t0) * scale + 0.5)
        x[k + 80] = np.floor((u2 - t1) * scale + 0.5)
        x[k + 96] = np.floor((u1 - t2) * scale + 0.5)
        x[k + 112] = np.floor((u0 - t3) * scale + 0.5)
