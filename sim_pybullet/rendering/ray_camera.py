"""``RayCamera``: what many robots see, by reading the floor where each pixel's ray meets it.

The floor is a mip pyramid of packed 32-bit texels: red in bits 0..7, green in bits 12..19 and blue
in bits 24..31, so that ``(t | t << 32) & LANES`` spreads the colours over a 64-bit word with room
to add up sixteen weighted texels. Each level has a border of one texel of the outside colour.
"""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise
from typing import NamedTuple
from weakref import WeakKeyDictionary

import numba
import numpy as np
from numba import njit, prange

from robot.contract import ImageSpec
from robot.lens import CameraRig
from sim_pybullet.classes import SemanticClass
from sim_pybullet.rendering.rays import (
    LEVELS,
    Background,
    Directions,
    FloorTable,
    Solids,
    background,
    directions_of,
    floor_shade,
    floor_table,
    light_row,
    mover_rows,
    solid_rows,
)
from sim_pybullet.rendering.solid_kernel import draw_solids
from sim_pybullet.scene import Ground, Mover, Scene

_ROWS: WeakKeyDictionary[Scene, np.ndarray] = WeakKeyDictionary()


class _View(NamedTuple):
    """What one robot looks at, and how."""

    ground: Ground
    behind: Background
    floor: FloorTable
    texture: MipTexture
    solids: Solids
    directions: Directions

    def placed(self, pose: np.ndarray) -> np.ndarray:
        """(4,) where a robot stands in the texture, see `draw_floor`."""
        (x, y, heading), ground = pose, self.ground
        column, row = (x - ground.west_m) / ground.texel_m, (ground.north_m - y) / ground.texel_m
        return np.array((column, row, np.cos(heading), np.sin(heading)))


class RayCamera:
    """Draws N robots' pictures in one call; keeps `sim_pybullet.rendering.camera.BatchCamera`.

    Every robot may have its own scene and rig; equal rigs share tables, scenes with the same
    ``Ground`` and light its packed floor. Neither may be changed in place after it was given.
    ``movers`` are drawn in every scene, where each picture's poses of them say.
    """

    def __init__(self, image: ImageSpec, n_robots: int, movers: tuple[Mover, ...] = ()) -> None:
        self._image = image
        self._views: list[_View | None] = [None] * n_robots
        self._away = np.full((len(movers), 3), np.nan)
        self._moving = mover_rows(movers)

    @property
    def shape(self) -> tuple[int, int, int]:
        """(H, W, 3) of one picture."""
        return self._image.shape

    def set_robot(self, i: int, scene: Scene, rig: CameraRig) -> None:
        """Give robot ``i`` its world and its camera."""
        if scene not in _ROWS:
            _ROWS[scene] = solid_rows(scene.solids)
        eye = np.array(rig.mount.position_m, dtype=np.float64)
        self._views[i] = _View(
            scene.ground,
            background(rig, self._image, scene),
            floor_table(rig, self._image, scene.ground.texel_m),
            mip_texture(scene.ground, floor_shade(scene.light)),
            Solids(_ROWS[scene], *self._moving, light_row(scene.light), eye),
            directions_of(rig, self._image),
        )

    def render(
        self,
        poses: np.ndarray,
        robots: np.ndarray | None = None,
        movers: np.ndarray | None = None,
    ) -> np.ndarray:
        """(N, H, W, 3) uint8 RGB, before any sensor effect; poses (N, 3): x, y [m], heading.

        With ``robots``, indices of some of them, poses and pictures are only theirs. ``movers``
        (N, U, 3): poses of what moves around each, NaN where it is not there.
        """

        def draw(picture: np.ndarray, view: _View, placed: np.ndarray) -> None:
            picture[:] = view.behind[0].reshape(picture.shape)
            draw_floor(picture.ravel(), placed, view.floor, view.texture)

        return self._each(draw, 3, poses, robots, movers)

    def segment(self, poses: np.ndarray, movers: np.ndarray | None = None) -> np.ndarray:
        """(N, H, W) uint8, values of SemanticClass."""

        def draw(labels: np.ndarray, view: _View, placed: np.ndarray) -> None:
            labels[:] = view.behind[1].reshape(labels.shape)
            label_floor(labels.ravel(), placed, view.floor, view.ground)

        return self._each(draw, 1, poses, None, movers)[..., 0]

    def _each(
        self,
        draw: Callable[[np.ndarray, _View, np.ndarray], None],
        channels: int,
        poses: np.ndarray,
        robots: np.ndarray | None,
        movers: np.ndarray | None,
    ) -> np.ndarray:
        """Pictures (N, H, W, channels): floors as ``draw`` has them, and what stands on them."""
        chosen = self._views if robots is None else [self._views[i] for i in robots.tolist()]
        views = [view for view in chosen if view is not None]
        poses = np.ascontiguousarray(poses, dtype=np.float64)
        if poses.shape != (len(views), 3) or len(views) < len(chosen):
            raise ValueError(
                f"RayCamera: expected poses ({len(chosen)}, 3) and set_robot for each robot, "
                f"got poses {poses.shape} and {len(views)} robots set"
            )
        pictures = np.empty((len(views), *self.shape[:2], channels), np.uint8)

        def work(some: np.ndarray) -> None:
            for k in some.tolist():
                draw(pictures[k], views[k], views[k].placed(poses[k]))
            for k in some.tolist():  # after all floors, or tables are read from far memory
                solids, around = views[k].solids, self._away if movers is None else movers[k]
                if len(solids.rows) or len(around):
                    draw_solids(pictures[k], solids, around, poses[k], views[k].directions)

        threads = min(numba.get_num_threads(), len(views))
        if threads <= 1:
            work(np.arange(len(views)))
        else:
            with ThreadPoolExecutor(threads) as pool:
                list(pool.map(work, np.array_split(np.arange(len(views)), threads)))
        return pictures


Points = tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]
LANES = np.uint64(0xFF | 0xFF << 24 | 0xFF << 44)  # red, blue, green with room for carries
HALF = np.uint64(128 | 128 << 24 | 128 << 44)


class MipTexture(NamedTuple):
    """All levels one after the other: ``texels`` (T,) uint32; ``levels`` (L, 3) int32 rows of
    offset, width and height, borders included."""

    texels: np.ndarray
    levels: np.ndarray


_PACKED: WeakKeyDictionary[Ground, dict[float, MipTexture]] = WeakKeyDictionary()


def mip_texture(ground: Ground, shade: float) -> MipTexture:
    """The pyramid of a floor under light that multiplies its colours by ``shade``.

    It is kept as long as the Ground lives: all cameras read the same one.
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
    code = outside[0] | outside[1] << 12 | outside[2] << 24
    texels = np.full(int(offsets[-1]), code, np.uint32)
    views = [texels[o : o + h * w].reshape(h, w) for o, w, h in levels]
    height, width = ground.classes.shape
    _pack(ground.rgb, np.float32(shade), views[0][1 : height + 1, 1 : width + 1])
    for finer, coarser in pairwise(views):
        _halve(finer[1:-1, 1:-1], coarser[1:-1, 1:-1])
    return MipTexture(texels, levels)


@njit(parallel=True, nogil=True, cache=True, fastmath=True)
def _pack(rgb: np.ndarray, shade: np.float32, out: np.ndarray) -> None:
    half, top = np.float32(0.5), np.float32(255.0)
    for v in prange(out.shape[0]):
        for u in range(out.shape[1]):
            red = np.uint32(min(rgb[v, u, 0] * shade + half, top))
            green = np.uint32(min(rgb[v, u, 1] * shade + half, top))
            blue = np.uint32(min(rgb[v, u, 2] * shade + half, top))
            out[v, u] = red | green << np.uint32(12) | blue << np.uint32(24)


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


def label_floor(labels: np.ndarray, placed: np.ndarray, table: FloorTable, ground: Ground) -> None:
    """Fill in of labels (P,) uint8 what pixels' rays meet on the floor; ``placed`` as drawn."""
    first, last, level, log_taps = table.runs.T
    count = last - first
    pixels = np.arange(count.sum()) + np.repeat(first - np.cumsum(count) + count, count)
    middle, size = np.repeat(0.5 * (2.0**log_taps - 1.0), count), np.repeat(2.0**level, count)
    ahead = (table.x[pixels] + middle * table.dx[pixels]) * size
    left = (table.y[pixels] + middle * table.dy[pixels]) * size
    column0, row0, c, s = placed
    column = np.floor(c * ahead - s * left + column0).astype(int)
    row = np.floor(row0 - s * ahead - c * left).astype(int)
    beside = np.pad(ground.classes, 1, constant_values=SemanticClass.OUTSIDE)
    high, wide = ground.classes.shape
    labels[pixels] = beside[np.clip(row, -1, high) + 1, np.clip(column, -1, wide) + 1]


class _Row(NamedTuple):
    """Scratch for one row of pixels: which texel, where in it (8 + 8 bits), colours so far."""

    texel: np.ndarray
    within: np.ndarray
    sums: np.ndarray


@njit(nogil=True, cache=True)
def draw_floor(
    picture: np.ndarray, placed: np.ndarray, table: FloorTable, texture: MipTexture
) -> None:
    """Fill in the floor of a picture (3 P,) uint8.

    ``placed`` (4,) float64 is where the robot stands in the texture: column and row of its origin
    [texels], cosine and sine of its heading.
    """
    texels, levels = texture
    longest = 0
    for run in range(len(table.runs)):
        longest = max(longest, table.runs[run, 1] - table.runs[run, 0])
    row = _Row(
        np.empty(longest, np.uint32), np.empty(longest, np.uint32), np.empty(longest, np.uint64)
    )
    for run in range(len(table.runs)):
        first, last, level, log_taps = table.runs[run]
        x, y = table.x[first:last], table.y[first:last]
        points = (x, y, table.dx[first:last], table.dy[first:last])
        offset, stride = levels[level, 0], levels[level, 1]
        row.sums[: last - first] = HALF << np.uint64(log_taps)
        for tap in range(1 << log_taps):
            _find_texels(row, points, np.float32(tap), placed, level, levels[level])
            _add_texels(row, texels[offset:], np.uint64(stride), last - first)
        _store(picture[3 * first : 3 * last], row.sums, np.uint64(8 + log_taps))


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
