"""The compiled loops that draw solids over the floor, four rays to a pixel."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit, prange

from sim_pybullet import solid_table as column
from sim_pybullet.solid_geometry import (
    NO_HIT,
    Outline,
    hit,
    looks_into,
    outline,
    pixel_box,
    to_camera,
)

_X, _Y, _KIND, _RED, _GREEN, _BLUE = (
    column.X,
    column.Y,
    column.KIND,
    column.RED,
    column.GREEN,
    column.BLUE,
)


class SolidViews(NamedTuple):
    """What stands around N robots, and from where they see it.

    ``poses`` (N, 3); ``eyes`` (N, 3) the camera in the robot frame [m]; ``lights`` (N, 5) as
    ``light_row``; ``rows`` (K, 13) as ``solid_rows``, robot i seeing first[i]..last[i];
    ``slots`` (N,) names each robot's ``directions`` (S, H, W, 3) and ``DirectionTable``.
    """

    poses: np.ndarray
    eyes: np.ndarray
    lights: np.ndarray
    rows: np.ndarray
    first: np.ndarray
    last: np.ndarray
    slots: np.ndarray
    directions: np.ndarray
    angles: np.ndarray
    cells: np.ndarray
    pixel_rad: np.ndarray


@njit(parallel=True, nogil=True, cache=True)
def draw_solids(pictures: np.ndarray, views: SolidViews) -> None:
    """Draw into pictures (N, H, W, 3) uint8; edges are blended over four rays per pixel."""
    for i in prange(len(pictures)):
        _draw_robot(pictures[i], views, i)


@njit(parallel=True, nogil=True, cache=True)
def label_solids(labels: np.ndarray, views: SolidViews) -> None:
    """Write the class of the nearest solid on each pixel's ray into labels (N, H, W) uint8."""
    for i in prange(len(labels)):
        _label_robot(labels[i], views, i)


@njit(cache=True)
def _near_to_far(views: SolidViews, i: int) -> np.ndarray:
    """The rows of a robot's solids as its camera has them, nearest first."""
    count = views.last[i] - views.first[i]
    rows = np.empty((count, views.rows.shape[1]))
    distances = np.empty(count)
    for k in range(count):
        to_camera(views.rows[views.first[i] + k], views.poses[i], views.eyes[i], rows[k])
        distances[k] = rows[k, _X] ** 2 + rows[k, _Y] ** 2
    return rows[np.argsort(distances)]


@njit(cache=True)
def _draw_robot(picture: np.ndarray, views: SolidViews, i: int) -> None:
    height, width = picture.shape[:2]
    slot = views.slots[i]
    light = _light_in_robot_frame(views.lights[i], views.poses[i, 2])
    depth = np.empty((0, 0), np.float32)
    colours = np.empty((0, 0, 3), np.float32)
    drawn_top, drawn_bottom = height, -1
    for row in _near_to_far(views, i):
        around = outline(row, views.pixel_rad[slot])
        box = pixel_box(around, views.cells[slot])
        if box[0] > box[1]:
            continue
        if len(depth) == 0:
            depth = np.full((height, 4 * width), np.float32(NO_HIT))
            colours = np.empty((height, 4 * width, 3), np.float32)
        _draw(row, light, views.directions[slot], views.angles[slot], around, box, depth, colours)
        drawn_top, drawn_bottom = min(drawn_top, box[0]), max(drawn_bottom, box[1])
    for v in range(drawn_top, drawn_bottom + 1):
        _blend(picture[v], depth[v], colours[v])


@njit(cache=True)
def _light_in_robot_frame(light: np.ndarray, heading: float) -> np.ndarray:
    c, s = math.cos(heading), math.sin(heading)
    turned = light.copy()
    turned[0], turned[1] = c * light[0] + s * light[1], c * light[1] - s * light[0]
    return turned


@njit(cache=True, fastmath=True, error_model="numpy")
def _draw(
    row: np.ndarray,
    light: np.ndarray,
    directions: np.ndarray,
    angles: np.ndarray,
    around: Outline,
    box: tuple[int, int, int, int],
    depth: np.ndarray,
    colours: np.ndarray,
) -> None:
    height, width = directions.shape[:2]
    top, bottom, left, right = box
    for v in range(top, bottom + 1):
        above, below = directions[max(v - 1, 0)], directions[min(v + 1, height - 1)]
        for u in range(left, right + 1):
            if not looks_into(angles[v, u], around):
                continue
            middle = directions[v, u]
            before, after = directions[v, max(u - 1, 0)], directions[v, min(u + 1, width - 1)]
            for ray in range(4):
                a, b = 0.125 * (2 * (ray & 1) - 1), 0.125 * (2 * (ray >> 1) - 1)
                dx = middle[0] + a * (after[0] - before[0]) + b * (below[u, 0] - above[u, 0])
                dy = middle[1] + a * (after[1] - before[1]) + b * (below[u, 1] - above[u, 1])
                dz = middle[2] + a * (after[2] - before[2]) + b * (below[u, 2] - above[u, 2])
                distance, nx, ny, nz = hit(row, dx, dy, dz)
                if distance < depth[v, 4 * u + ray]:
                    depth[v, 4 * u + ray] = distance
                    lit = max(0.0, nx * light[0] + ny * light[1] + nz * light[2])
                    shade = light[3] + light[4] * lit
                    colours[v, 4 * u + ray, 0] = min(row[_RED] * shade, 255.0)
                    colours[v, 4 * u + ray, 1] = min(row[_GREEN] * shade, 255.0)
                    colours[v, 4 * u + ray, 2] = min(row[_BLUE] * shade, 255.0)


@njit(cache=True)
def _blend(picture: np.ndarray, depth: np.ndarray, colours: np.ndarray) -> None:
    for u in range(len(picture)):
        for c in range(3):
            total = np.float32(0.5)
            for ray in range(4 * u, 4 * u + 4):
                seen = colours[ray, c] if depth[ray] < NO_HIT else np.float32(picture[u, c])
                total += np.float32(0.25) * seen
            picture[u, c] = np.uint8(total)


@njit(cache=True)
def _label_robot(labels: np.ndarray, views: SolidViews, i: int) -> None:
    slot = views.slots[i]
    directions, angles = views.directions[slot], views.angles[slot]
    depth = np.full(labels.shape, np.float32(NO_HIT))
    for row in _near_to_far(views, i):
        around = outline(row, views.pixel_rad[slot])
        top, bottom, left, right = pixel_box(around, views.cells[slot])
        for v in range(top, bottom + 1):
            for u in range(left, right + 1):
                if looks_into(angles[v, u], around):
                    d = directions[v, u]
                    distance = hit(row, d[0], d[1], d[2])[0]
                    if distance < depth[v, u]:
                        depth[v, u] = distance
                        labels[v, u] = np.uint8(row[_KIND])
