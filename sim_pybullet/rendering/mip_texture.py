"""The floor as compiled code reads it: packed 32-bit texels in a mip pyramid.

A texel holds red in bits 0..7, the semantic class in bits 8..11, green in bits 12..19 and blue in
bits 24..31, so that ``(t | t << 32) & LANES`` spreads the colours over a 64-bit word with room to
add up sixteen weighted texels. Each level has a border of one texel of the outside colour.
"""

from itertools import pairwise
from weakref import WeakKeyDictionary

import numpy as np
from numba import njit, prange

from sim_pybullet.rendering.rays import LEVELS
from sim_pybullet.scene import Ground, SemanticClass

MipTexture = tuple[np.ndarray, np.ndarray]
_PACKED: WeakKeyDictionary[Ground, dict[float, MipTexture]] = WeakKeyDictionary()


def mip_texture(ground: Ground, shade: float) -> MipTexture:
    """The pyramid of a floor under light that multiplies its colours by ``shade``.

    The texels (T,) uint32 of all levels, one after the other, and rows (L, 3) int32 of their
    offset, width and height, borders included. They are kept as long as the Ground lives: all
    cameras read the same ones.
    """
    packed = _PACKED.setdefault(ground, {})
    if shade not in packed:
        packed[shade] = _build(ground, shade)
    return packed[shade]


def _build(ground: Ground, shade: float) -> MipTexture:
    step = 1 << (LEVELS - 1)
    rows, columns = (-(-n // step) * step for n in ground.classes.shape)
    shapes = [((rows >> i) + 2, (columns >> i) + 2) for i in range(LEVELS)]
    offsets = np.concatenate(([0], np.cumsum([h * w for h, w in shapes])))
    levels = np.array([(o, w, h) for o, (h, w) in zip(offsets, shapes, strict=False)], np.int32)
    outside = np.clip(np.array(ground.outside_rgb) * shade + 0.5, 0.0, 255.0).astype(np.uint32)
    code = outside[0] | outside[1] << 12 | outside[2] << 24 | int(SemanticClass.OUTSIDE) << 8
    texels = np.full(int(offsets[-1]), code, np.uint32)
    views = [texels[o : o + h * w].reshape(h, w) for o, w, h in levels]
    height, width = ground.classes.shape
    _pack(ground.rgb, ground.classes, np.float32(shade), views[0][1 : height + 1, 1 : width + 1])
    for finer, coarser in pairwise(views):
        _halve(finer[1:-1, 1:-1], coarser[1:-1, 1:-1])
    return texels, levels


@njit(parallel=True, nogil=True, cache=True, fastmath=True)
def _pack(rgb: np.ndarray, classes: np.ndarray, shade: np.float32, out: np.ndarray) -> None:
    half, top = np.float32(0.5), np.float32(255.0)
    for v in prange(out.shape[0]):
        for u in range(out.shape[1]):
            red = np.uint32(min(rgb[v, u, 0] * shade + half, top))
            green = np.uint32(min(rgb[v, u, 1] * shade + half, top))
            blue = np.uint32(min(rgb[v, u, 2] * shade + half, top))
            kind = np.uint32(classes[v, u])
            out[v, u] = red | kind << np.uint32(8) | green << np.uint32(12) | blue << np.uint32(24)


@njit(parallel=True, nogil=True, cache=True)
def _halve(finer: np.ndarray, coarser: np.ndarray) -> None:
    """Average squares of four texels, three colours in one word."""
    lanes = np.uint64(0xFF | 0xFF << 12 | 0xFF << 24)
    rounding, two = np.uint64(2 | 2 << 12 | 2 << 24), np.uint64(2)
    for v in prange(coarser.shape[0]):
        above, below, target = finer[2 * v], finer[2 * v + 1], coarser[v]
        for u in range(len(target)):
            total = (np.uint64(above[2 * u]) & lanes) + (np.uint64(above[2 * u + 1]) & lanes)
            total += (np.uint64(below[2 * u]) & lanes) + (np.uint64(below[2 * u + 1]) & lanes)
            target[u] = np.uint32(((total + rounding) >> two) & lanes)
