"""The compiled loops that draw solids over the floor, four rays to a pixel."""

import math
from typing import NamedTuple

import numpy as np
from numba import njit, prange

from sim_pybullet.rendering import solid_geometry as solid


class SolidViews(NamedTuple):
    """What stands around N robots, and from where they see it."""

    poses: np.ndarray  # (N, 3)
    eyes: np.ndarray  # (N, 3) the camera in the robot frame [m]
    lights: np.ndarray  # (N, 5) as ``light_row``
    rows: np.ndarray  # (K, 13) as ``solid_rows``, of which robot i sees first[i]..last[i]
    first: np.ndarray
    last: np.ndarray
    slots: np.ndarray  # (N,) each robot's in the rest, of which the last two are `direction_table`s
    directions: np.ndarray  # (S, 3, H, W)
    cells: np.ndarray
    pixel_rad: np.ndarray


@njit(parallel=True, nogil=True, cache=True)
def draw_solids(pictures: np.ndarray, views: SolidViews) -> None:
    """Draw solids into pictures, (N, H, W, 3) uint8 RGB or (N, H, W, 1) uint8 classes.

    Edges of colours are blended over four rays per pixel; a class is that of one ray.
    """
    for i in prange(len(pictures)):
        _draw(pictures[i], views, np.int64(i))


@njit(cache=True)
def _in_sight(views: SolidViews, i: np.int64) -> tuple[np.ndarray, np.ndarray]:
    """The solids that a robot's camera sees: rows (k, 13) and pixel boxes (k, 4)."""
    count = views.last[i] - views.first[i]
    rows = np.empty((count, views.rows.shape[1]))
    boxes = np.empty((count, 4), np.int64)
    slot, seen = views.slots[i], 0
    for k in range(views.first[i], views.last[i]):
        solid.to_camera(views.rows[k], views.poses[i], views.eyes[i], rows[seen])
        around = solid.outline(rows[seen], views.pixel_rad[slot])
        if solid.pixel_box(around, views.cells[slot], boxes[seen]):
            seen += 1
    return rows[:seen], boxes[:seen]


@njit(cache=True)
def _light(views: SolidViews, i: np.int64) -> np.ndarray:
    """Light (5,) in the robot's axes."""
    light = views.lights[i].copy()
    c, s = math.cos(views.poses[i, 2]), math.sin(views.poses[i, 2])
    light[0], light[1] = c * light[0] + s * light[1], c * light[1] - s * light[0]
    return light


@njit(parallel=True, nogil=True, cache=True)
def in_sight(
    views: SolidViews, most: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """What N cameras see of up to ``most`` solids each, for who meets them with rays elsewhere.

    Rows (N, K, 13) as `to_camera`, boxes (N, K, 4) as `pixel_box`, colours (N, K, 3) as
    `face_colours`, lights (N, 5) in the robots' axes, and which (N, K) of these are in sight.
    """
    n = len(views.poses)
    rows, boxes = np.zeros((n, most, views.rows.shape[1])), np.zeros((n, most, 4), np.int64)
    colours, lights = np.zeros((n, most, 3), np.uint32), np.zeros((n, 5))
    seen = np.zeros((n, most), np.bool_)
    for i in prange(n):
        mine, around = _in_sight(views, np.int64(i))
        lights[i], count = _light(views, np.int64(i)), len(mine)
        rows[i, :count], boxes[i, :count], seen[i, :count] = mine, around, True
        for k in range(count):
            solid.face_colours(rows[i, k], lights[i], colours[i, k])
    return rows, boxes, colours, lights, seen


@njit(cache=True)
def _draw(picture: np.ndarray, views: SolidViews, i: np.int64) -> None:
    """Draw what one robot sees, row by row: what a row needs stays in the processor's cache."""
    samples = 1 if picture.shape[2] == 1 else 4
    rows, boxes = _in_sight(views, i)
    light = _light(views, i) if samples > 1 else np.zeros(5)
    colours = np.empty((len(rows), 3), np.uint32)
    top, bottom = len(picture), 0
    for k in range(len(rows)):
        solid.face_colours(rows[k], light, colours[k])
        if samples == 1:
            colours[k] = np.uint32(rows[k, solid.KIND])
        top, bottom = min(top, boxes[k, 0]), max(bottom, boxes[k, 1] + 1)
    width, directions = picture.shape[1], views.directions[views.slots[i]]
    rays = np.empty((3, width, samples), np.float32)  # of a row
    flat = rays.reshape(3, -1)
    depth = np.empty(samples * width, np.float32)  # along them [m]
    seen = np.empty(samples * width, np.uint32)  # there: the nearest solid's colour or class
    for v in range(top, bottom):
        left, right = width, 0
        for k in range(len(rows)):
            if boxes[k, 0] <= v <= boxes[k, 1]:
                left, right = min(left, boxes[k, 2]), max(right, boxes[k, 3] + 1)
        _cast(directions, v, left, right, rays)
        depth[samples * left : samples * right] = np.float32(solid.NO_HIT)
        for k in range(len(rows)):
            if boxes[k, 0] <= v <= boxes[k, 1]:
                first, last = samples * boxes[k, 2], samples * (boxes[k, 3] + 1)
                if rows[k, solid.ROUND] > 0.0:
                    solid.meet_cylinder(rows[k], light, colours[k], flat, depth, seen, first, last)
                else:
                    solid.meet_box(rows[k], colours[k], flat, depth, seen, first, last)
        if samples == 1:
            _label(picture[v], depth, seen, left, right)
        else:
            _blend(picture[v], depth, seen, left, right)


@njit(cache=True)
def _cast(directions: np.ndarray, v: int, left: int, right: int, rays: np.ndarray) -> None:
    """The rays (3, W, s) through columns left..right - 1 of a row: its pixels' middles, or four
    rays, each a quarter of a pixel aside and up or down."""
    height, width = directions.shape[1:]
    inner, outer = max(left, 1), min(right, width - 1)
    for axis in range(3):
        middle, target = directions[axis, v], rays[axis]
        if target.shape[1] == 1:
            target[left:right, 0] = middle[left:right]
            continue
        above, below = directions[axis, max(v - 1, 0)], directions[axis, min(v + 1, height - 1)]
        here, high, low = middle[inner:outer], above[inner:outer], below[inner:outer]
        after, before = middle[inner + 1 : outer + 1], middle[inner - 1 : outer - 1]
        four = target[inner:outer]
        for k in range(len(here)):  # slices from zero on, or this does not become SIMD code
            _spread(here[k], after[k] - before[k], low[k] - high[k], four, k)
        for u in (0, width - 1):
            if left <= u < right:
                across = middle[min(u + 1, width - 1)] - middle[max(u - 1, 0)]
                _spread(middle[u], across, below[u] - above[u], target, u)


@njit(inline="always")
def _spread(
    middle: np.float32, across: np.float32, down: np.float32, rays: np.ndarray, u: int
) -> None:
    across, down = np.float32(0.125) * across, np.float32(0.125) * down
    rays[u, 0], rays[u, 1] = middle - across - down, middle + across - down
    rays[u, 2], rays[u, 3] = middle - across + down, middle + across + down


@njit(cache=True)
def _blend(picture: np.ndarray, depth: np.ndarray, seen: np.ndarray, left: int, right: int) -> None:
    """Mix what four rays per pixel met with what is behind it, picture (W, 3)."""
    byte, two = np.uint32(255), np.uint32(2)
    for u in range(left, right):
        bare = np.uint32(0)
        red = green = blue = two
        for ray in range(4 * u, 4 * u + 4):
            if depth[ray] < solid.NO_HIT:
                red += seen[ray] & byte
                green += seen[ray] >> np.uint32(8) & byte
                blue += seen[ray] >> np.uint32(16)
            else:
                bare += np.uint32(1)
        if bare < 4:
            picture[u, 0] = (red + bare * picture[u, 0]) >> two
            picture[u, 1] = (green + bare * picture[u, 1]) >> two
            picture[u, 2] = (blue + bare * picture[u, 2]) >> two


@njit(cache=True)
def _label(picture: np.ndarray, depth: np.ndarray, seen: np.ndarray, left: int, right: int) -> None:
    for u in range(left, right):
        if depth[u] < solid.NO_HIT:
            picture[u, 0] = seen[u]
