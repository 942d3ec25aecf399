"""The compiled loops that draw solids over the floor, four rays to a pixel."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from sim_pybullet.rendering.rays import (
    AZIMUTHS,
    BASE,
    BLUE,
    COS,
    CYLINDER,
    ELEVATIONS,
    GREEN,
    HALF_LENGTH,
    HALF_WIDTH,
    KIND,
    RED,
    SHAPE,
    SIN,
    TOP,
    Directions,
    Solids,
    X,
    Y,
)  # fmt: skip

NO_HIT = 1e9
# Not nnan, ninf: a ray may be level with a face.
_FAST = {"contract", "arcp", "nsz", "reassoc"}


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


@njit(nogil=True, cache=True)
def draw_solids(
    picture: np.ndarray,
    solids: Solids,
    movers: np.ndarray,
    pose: np.ndarray,
    directions: Directions,
) -> None:
    """Draw solids into a picture, (H, W, 3) uint8 RGB or (H, W, 1) uint8 classes.

    Edges of colours blend four rays per pixel; a class is that of one. ``movers`` (U, 3): poses of
    what moves, not finite where it is not there; ``pose`` (3,): the robot's.
    """
    labels = picture.shape[2] == 1
    canvas = _look(solids, movers, pose, directions, 1 if labels else 4)
    for v in range(len(canvas.depth)):
        line = picture[canvas.top + v, canvas.left :]
        if not labels:
            _blend(line, canvas.depth[v], canvas.seen[v])
            continue
        for u in range(canvas.depth.shape[2]):
            if canvas.depth[v, 0, u] < NO_HIT:
                line[u, 0] = canvas.seen[v, 0, u]


@njit(cache=True)
def _look(
    solids: Solids, movers: np.ndarray, pose: np.ndarray, directions: Directions, samples: int
) -> Canvas:
    rows, boxes = _in_sight(solids, movers, pose, directions)
    canvas = _canvas(boxes, directions.rays, samples)
    light = np.zeros(5)
    if samples > 1:  # into the robot's axes
        light[:] = solids.light
        c, s = math.cos(pose[2]), math.sin(pose[2])
        light[0], light[1] = c * light[0] + s * light[1], c * light[1] - s * light[0]
    colours = np.empty(3, np.uint32)
    for k in range(len(rows)):
        _face_colours(rows[k], light, colours)
        if samples == 1:
            colours[0] = colours[1] = colours[2] = np.uint32(rows[k, KIND])
        first, last = boxes[k, 2] - canvas.left, boxes[k, 3] + 1 - canvas.left
        for v in range(boxes[k, 0] - canvas.top, boxes[k, 1] + 1 - canvas.top):
            rays, depth, seen = canvas.rays[v], canvas.depth[v], canvas.seen[v]
            if rows[k, SHAPE] == CYLINDER:
                _meet_cylinder(rows[k], light, colours, rays, depth, seen, first, last)
            else:
                _meet_box(rows[k], colours, rays, depth, seen, first, last)
    return canvas


@njit(cache=True)
def _in_sight(
    solids: Solids, movers: np.ndarray, pose: np.ndarray, directions: Directions
) -> tuple[np.ndarray, np.ndarray]:
    """The solids that a robot's camera sees: rows (k, 13) and pixel boxes (k, 4)."""
    standing = len(solids.rows)
    rows = np.empty((standing + len(solids.parts), 13))
    boxes = np.empty((len(rows), 4), np.int64)
    seen = 0
    for k in range(len(rows)):
        row = rows[seen]
        if k < standing:
            row[:] = solids.rows[k]
        else:
            origin = movers[solids.owners[k - standing]]
            if not math.isfinite(origin[0]):
                continue
            row[:] = solids.parts[k - standing]
            _move(row, origin)
        _to_camera(row, pose, solids.eye)
        if _pixel_box(row, directions, boxes[seen]):
            seen += 1
    return rows[:seen], boxes[:seen]


@njit(cache=True)
def _move(row: np.ndarray, origin: np.ndarray) -> None:
    """A row about an origin (3,) as one in the world."""
    c, s = math.cos(origin[2]), math.sin(origin[2])
    x, y, cosine, sine = row[X], row[Y], row[COS], row[SIN]
    row[X], row[Y] = origin[0] + c * x - s * y, origin[1] + s * x + c * y
    row[COS], row[SIN] = c * cosine - s * sine, s * cosine + c * sine


@njit(cache=True)
def _to_camera(row: np.ndarray, pose: np.ndarray, eye: np.ndarray) -> None:
    """A world row as the camera has it: relative to the eye (3,), axes of the robot."""
    c, s = math.cos(pose[2]), math.sin(pose[2])
    dx, dy, cosine, sine = row[X] - pose[0], row[Y] - pose[1], row[COS], row[SIN]
    row[X], row[Y] = c * dx + s * dy - eye[0], c * dy - s * dx - eye[1]
    row[COS], row[SIN] = c * cosine + s * sine, c * sine - s * cosine
    row[BASE] -= eye[2]
    row[TOP] -= eye[2]


@njit(cache=True)
def _pixel_box(row: np.ndarray, directions: Directions, box: np.ndarray) -> bool:
    """Whether pixels look to a solid: their first, last row, first, last column into box (4,)."""
    distance, margin = math.hypot(row[X], row[Y]), directions.pixel_rad
    radius = row[HALF_LENGTH]
    if row[SHAPE] != CYLINDER:
        radius = math.hypot(row[HALF_LENGTH], row[HALF_WIDTH])
    low, high, spread = -0.5 * math.pi, 0.5 * math.pi, math.pi
    if distance >= radius + 1e-6:
        near, far = distance - radius, distance + radius
        low = math.atan2(row[BASE], near if row[BASE] < 0.0 else far) - margin
        high = math.atan2(row[TOP], near if row[TOP] > 0.0 else far) + margin
        # A pixel near straight down or up is wider in azimuth than on the horizon.
        level = max(1e-3, math.cos(max(abs(low), abs(high)) - margin))
        spread = math.asin(radius / distance) + margin / level
        spread = min(spread, math.pi)
    azimuth = math.atan2(row[Y], row[X])
    first_azimuth = math.floor(((azimuth - spread) / math.pi + 1.0) * (AZIMUTHS // 2))
    last_azimuth = math.floor(((azimuth + spread) / math.pi + 1.0) * (AZIMUTHS // 2))
    first_elevation = max(0, int((low / math.pi + 0.5) * ELEVATIONS))
    last_elevation = min(ELEVATIONS - 1, int((high / math.pi + 0.5) * ELEVATIONS))
    box[0] = box[2] = 1 << 30
    box[1] = box[3] = -1
    for i in range(first_azimuth, min(last_azimuth, first_azimuth + AZIMUTHS - 1) + 1):
        for j in range(first_elevation, last_elevation + 1):
            cell = directions.cells[i % AZIMUTHS, j]
            box[0], box[1] = min(box[0], cell[0]), max(box[1], cell[1])
            box[2], box[3] = min(box[2], cell[2]), max(box[3], cell[3])
    return box[0] <= box[1]


@njit(cache=True, fastmath=_FAST, error_model="numpy")
def _meet_box(
    row: np.ndarray,
    colours: np.ndarray,
    rays: np.ndarray,
    depth: np.ndarray,
    seen: np.ndarray,
    first: int,
    last: int,
) -> None:
    """Put a box where it is the nearest along its rays: slabs, Kay and Kajiya 1986.

    Of s rays for each of w pixels, ``rays`` (3, s, w) float32, those of pixels first..last are
    tried. ``depth`` (s, w) float32 and what is ``seen`` there, uint32, change where the box is
    nearer. ``colours`` (3,) are those of the faces across its height, its length and its width.
    """
    one = np.float32(1.0)
    c, s = np.float32(row[COS]), np.float32(row[SIN])
    x = np.float32(row[COS] * row[X] + row[SIN] * row[Y])
    y = np.float32(row[COS] * row[Y] - row[SIN] * row[X])
    half_x, half_y = np.float32(row[HALF_LENGTH]), np.float32(row[HALF_WIDTH])
    base, top = np.float32(row[BASE]), np.float32(row[TOP])
    cap, front, flank = colours
    for sample in range(len(depth)):
        rx, ry, rz = rays[0, sample, first:last], rays[1, sample, first:last], rays[2, sample]
        rz, near, shown = rz[first:last], depth[sample, first:last], seen[sample, first:last]
        for k in range(len(near)):
            along_x, along_y = one / (c * rx[k] + s * ry[k]), one / (c * ry[k] - s * rx[k])
            along_z = one / rz[k]
            x0, x1 = (x - half_x) * along_x, (x + half_x) * along_x
            y0, y1 = (y - half_y) * along_y, (y + half_y) * along_y
            z0, z1 = base * along_z, top * along_z
            into_x, into_y, into_z = min(x0, x1), min(y0, y1), min(z0, z1)
            enter = max(into_x, into_y, into_z)
            leave = min(max(x0, x1), max(y0, y1), max(z0, z1))
            nearest = (enter > 0.0) & (enter <= leave) & (enter < near[k])
            colour = cap if enter == into_z else (front if enter == into_x else flank)
            near[k] = enter if nearest else near[k]
            shown[k] = colour if nearest else shown[k]


@njit(cache=True, fastmath=_FAST, error_model="numpy")
def _meet_cylinder(
    row: np.ndarray,
    light: np.ndarray,
    colours: np.ndarray,
    rays: np.ndarray,
    depth: np.ndarray,
    seen: np.ndarray,
    first: int,
    last: int,
) -> None:
    """As ``_meet_box``; ``colours[0]`` is the cap's, the side is lit by its normal.

    A ``light`` of no strength (ambient and diffuse 0) gives the side the cap's.
    """
    zero, one = np.float32(0.0), np.float32(1.0)
    x, y, radius = np.float32(row[X]), np.float32(row[Y]), np.float32(row[HALF_LENGTH])
    outside = np.float32(row[X] ** 2 + row[Y] ** 2 - row[HALF_LENGTH] ** 2)
    base, top = np.float32(row[BASE]), np.float32(row[TOP])
    light_x, light_y = np.float32(light[0]) / radius, np.float32(light[1]) / radius
    ambient, diffuse = np.float32(light[3]), np.float32(light[4])
    red, green, blue = np.float32(row[RED]), np.float32(row[GREEN]), np.float32(row[BLUE])
    dark, cap = ambient + diffuse == 0.0, colours[0]
    for sample in range(len(depth)):
        rx, ry, rz = rays[0, sample, first:last], rays[1, sample, first:last], rays[2, sample]
        rz, near, shown = rz[first:last], depth[sample, first:last], seen[sample, first:last]
        for k in range(len(near)):
            dx, dy = rx[k], ry[k]
            per_level = one / max(dx * dx + dy * dy, np.float32(1e-12))
            middle = (x * dx + y * dy) * per_level
            root = middle * middle - outside * per_level
            half = math.sqrt(max(root, zero))
            along_z = one / rz[k]
            z0, z1 = base * along_z, top * along_z
            into_z = min(z0, z1)
            enter = max(middle - half, into_z)
            leave = min(middle + half, max(z0, z1))
            nearest = (root > 0.0) & (enter > 0.0) & (enter <= leave) & (enter < near[k])
            facing = (enter * dx - x) * light_x + (enter * dy - y) * light_y
            colour = _pack(red, green, blue, ambient + diffuse * max(zero, facing))
            colour = cap if (enter == into_z) | dark else colour
            near[k] = enter if nearest else near[k]
            shown[k] = colour if nearest else shown[k]


@njit(inline="always")
def _pack(red: np.float32, green: np.float32, blue: np.float32, shade: np.float32) -> np.uint32:
    """A colour under a shade as red, green << 8 and blue << 16."""
    half, high = np.float32(0.5), np.float32(255.0)
    r = np.uint32(np.int32(min(red * shade + half, high)))
    g = np.uint32(np.int32(min(green * shade + half, high)))
    b = np.uint32(np.int32(min(blue * shade + half, high)))
    return r | g << np.uint32(8) | b << np.uint32(16)


@njit(cache=True)
def _face_colours(row: np.ndarray, light: np.ndarray, colours: np.ndarray) -> None:
    """Lambert colours of the faces that the camera can see, as ``_meet_box`` wants them."""
    c, s = row[COS], row[SIN]
    up = 1.0 if row[TOP] < 0.0 else -1.0
    ahead = -math.copysign(1.0, c * row[X] + s * row[Y])
    left = -math.copysign(1.0, c * row[Y] - s * row[X])
    facing = (up * light[2], ahead * (c * light[0] + s * light[1]))
    facing_left = left * (c * light[1] - s * light[0])
    for k, cosine in enumerate((facing[0], facing[1], facing_left)):
        shade = np.float32(light[3] + light[4] * max(0.0, cosine))
        red, green, blue = row[RED], row[GREEN], row[BLUE]
        colours[k] = _pack(np.float32(red), np.float32(green), np.float32(blue), shade)


@njit(cache=True)
def _canvas(boxes: np.ndarray, directions: np.ndarray, samples: int) -> Canvas:
    top, left = directions.shape[1:]
    bottom = right = -1
    for box in boxes:
        top, bottom = min(top, box[0]), max(bottom, box[1])
        left, right = min(left, box[2]), max(right, box[3])
    height, width = max(0, bottom + 1 - top), max(0, right + 1 - left)
    depth = np.full((height, samples, width), np.float32(NO_HIT))
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
            if depth[ray, u] < NO_HIT:
                red += seen[ray, u] & byte
                green += seen[ray, u] >> np.uint32(8) & byte
                blue += seen[ray, u] >> np.uint32(16)
            else:
                bare += np.uint32(1)
        if bare < 4:
            picture[u, 0] = (red + bare * picture[u, 0]) >> two
            picture[u, 1] = (green + bare * picture[u, 1]) >> two
            picture[u, 2] = (blue + bare * picture[u, 2]) >> two
