"""The compiled loops that draw solids over the floor, four rays to a pixel."""

import math
from typing import NamedTuple

import numpy as np
from numba import njit, prange

from sim_pybullet.rendering import solid_geometry as solid


class SolidViews(NamedTuple):
    """What stands around N robots, and from where they see it.

    ``poses`` (N, 3); ``eyes`` (N, 3) the camera in the robot frame [m]; ``lights`` (N, 5) as
    ``light_row``; ``rows`` (K, 13) as ``solid_rows``, robot i seeing first[i]..last[i];
    ``slots`` (N,) names each robot's ``directions`` (S, 3, H, W) and `direction_table`.
    """

    poses: np.ndarray
    eyes: np.ndarray
    lights: np.ndarray
    rows: np.ndarray
    first: np.ndarray
    last: np.ndarray
    slots: np.ndarray
    directions: np.ndarray
    cells: np.ndarray
    pixel_rad: np.ndarray


class Canvas(NamedTuple):
    """The part of a picture in which solids are seen, by ``samples`` rays per pixel.

    ``rays`` (h, 3, samples, w) float32; ``depth`` (h, samples, w) float32 along them [m] and what
    is ``seen`` there, uint32: the colour or the class of the nearest solid.
    """

    top: int
    left: int
    rays: np.ndarray
    depth: np.ndarray
    seen: np.ndarray


@njit(parallel=True, nogil=True, cache=True)
def draw_solids(pictures: np.ndarray, views: SolidViews) -> None:
    """Draw solids into pictures, (N, H, W, 3) uint8 RGB or (N, H, W, 1) uint8 classes.

    Edges of colours are blended over four rays per pixel; a class is that of one ray.
    """
    labels = pictures.shape[3] == 1
    for i in prange(len(pictures)):
        canvas = _look(views, np.int64(i), 1 if labels else 4)
        for v in range(len(canvas.depth)):
            picture = pictures[i, canvas.top + v, canvas.left :]
            if labels:
                _label(picture, canvas.depth[v], canvas.seen[v])
            else:
                _blend(picture, canvas.depth[v], canvas.seen[v])


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
def _look(views: SolidViews, i: np.int64, samples: int) -> Canvas:
    """What one robot sees: colours by four rays per pixel, or classes by one."""
    rows, boxes = _in_sight(views, i)
    canvas = _canvas(boxes, views.directions[views.slots[i]], samples)
    light = _light(views, i) if samples > 1 else np.zeros(5)
    colours = np.empty(3, np.uint32)
    for k in range(len(rows)):
        solid.face_colours(rows[k], light, colours)
        if samples == 1:
            colours[0] = colours[1] = colours[2] = np.uint32(rows[k, solid.KIND])
        first, last = boxes[k, 2] - canvas.left, boxes[k, 3] + 1 - canvas.left
        for v in range(boxes[k, 0] - canvas.top, boxes[k, 1] + 1 - canvas.top):
            rays, depth, seen = canvas.rays[v], canvas.depth[v], canvas.seen[v]
            if rows[k, solid.ROUND] > 0.0:
                solid.meet_cylinder(rows[k], light, colours, rays, depth, seen, first, last)
            else:
                solid.meet_box(rows[k], colours, rays, depth, seen, first, last)
    return canvas


@njit(cache=True)
def _canvas(boxes: np.ndarray, directions: np.ndarray, samples: int) -> Canvas:
    """An empty canvas over all pixel boxes."""
    top, left = directions.shape[1:]
    bottom = right = -1
    for box in boxes:
        top, bottom = min(top, box[0]), max(bottom, box[1])
        left, right = min(left, box[2]), max(right, box[3])
    height, width = max(0, bottom + 1 - top), max(0, right + 1 - left)
    depth = np.full((height, samples, width), np.float32(solid.NO_HIT))
    seen = np.empty((height, samples, width), np.uint32)
    rays = np.empty((height, 3, samples, width), np.float32)
    spread = np.float32(0.125 if samples > 1 else 0.0)
    for v in range(height):
        for sample in range(samples):
            a, b = np.float32(2 * (sample & 1) - 1), np.float32(2 * (sample >> 1) - 1)
            for axis in range(3):
                target = rays[v, axis, sample]
                _cast(directions[axis], top + v, left, spread * a, spread * b, target)
    return Canvas(top, left, rays, depth, seen)


@njit(cache=True, fastmath=True)
def _cast(
    directions: np.ndarray, v: int, first: int, a: np.float32, b: np.float32, rays: np.ndarray
) -> None:
    """One component of the rays through a row's pixels, 2 a columns and 2 b rows aside."""
    height, width = directions.shape
    last = first + len(rays)
    inner, outer = max(first, 1), min(last, width - 1)
    middle, above, below = directions[v], directions[max(v - 1, 0)], directions[v]
    if v + 1 < height:
        below = directions[v + 1]
    here, high, low = middle[inner:outer], above[inner:outer], below[inner:outer]
    right, left = middle[inner + 1 : outer + 1], middle[inner - 1 : outer - 1]
    target = rays[inner - first : outer - first]
    for k in range(len(target)):  # slices from zero on, or this does not become SIMD code
        target[k] = here[k] + a * (right[k] - left[k]) + b * (low[k] - high[k])
    for u in (0, width - 1):
        if first <= u < last:
            aside = a * (middle[min(u + 1, width - 1)] - middle[max(u - 1, 0)])
            rays[u - first] = middle[u] + aside + b * (below[u] - above[u])


@njit(cache=True)
def _blend(picture: np.ndarray, depth: np.ndarray, seen: np.ndarray) -> None:
    """Mix what four rays per pixel met with what is behind it, picture (>= w, 3)."""
    byte, two = np.uint32(255), np.uint32(2)
    for u in range(depth.shape[1]):
        bare = np.uint32(0)
        red = green = blue = two
        for ray in range(4):
            if depth[ray, u] < solid.NO_HIT:
                red += seen[ray, u] & byte
                green += seen[ray, u] >> np.uint32(8) & byte
                blue += seen[ray, u] >> np.uint32(16)
            else:
                bare += np.uint32(1)
        if bare < 4:
            picture[u, 0] = (red + bare * picture[u, 0]) >> two
            picture[u, 1] = (green + bare * picture[u, 1]) >> two
            picture[u, 2] = (blue + bare * picture[u, 2]) >> two


@njit(cache=True)
def _label(picture: np.ndarray, depth: np.ndarray, seen: np.ndarray) -> None:
    for u in range(depth.shape[1]):
        if depth[0, u] < solid.NO_HIT:
            picture[u, 0] = seen[0, u]
