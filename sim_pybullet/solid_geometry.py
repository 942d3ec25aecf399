"""Compiled geometry of one solid seen along one ray, in the robot's frame from the camera."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from sim_pybullet import solid_table as column
from sim_pybullet.solid_table import AZIMUTHS, ELEVATIONS

NO_HIT = 1e9
_X, _Y, _COS, _SIN = column.X, column.Y, column.COS, column.SIN
_LENGTH, _WIDTH, _BASE, _TOP = column.HALF_LENGTH, column.HALF_WIDTH, column.BASE, column.TOP
_SHAPE = column.SHAPE
Hit = tuple[float, float, float, float]  # distance along the ray, outward normal
Outline = tuple[float, float, float, float]  # azimuth, half its spread, lowest, highest [rad]


@njit(cache=True)
def to_camera(row: np.ndarray, pose: np.ndarray, eye: np.ndarray, out: np.ndarray) -> None:
    """A world row as the camera has it: relative to the eye (3,), axes of the robot."""
    c, s = math.cos(pose[2]), math.sin(pose[2])
    dx, dy = row[_X] - pose[0], row[_Y] - pose[1]
    out[:] = row
    out[_X] = c * dx + s * dy - eye[0]
    out[_Y] = c * dy - s * dx - eye[1]
    out[_COS] = c * row[_COS] + s * row[_SIN]
    out[_SIN] = c * row[_SIN] - s * row[_COS]
    out[_BASE] -= eye[2]
    out[_TOP] -= eye[2]


@njit(cache=True)
def outline(row: np.ndarray, margin_rad: float) -> Outline:
    """Directions that enclose the solid as seen from the camera, wider by a margin."""
    distance = math.hypot(row[_X], row[_Y])
    radius = row[_LENGTH] if row[_SHAPE] == 1 else math.hypot(row[_LENGTH], row[_WIDTH])
    if distance < radius + 1e-6:
        return 0.0, math.pi, -0.5 * math.pi, 0.5 * math.pi
    near, far = distance - radius, distance + radius
    low = math.atan2(row[_BASE], near if row[_BASE] < 0.0 else far)
    high = math.atan2(row[_TOP], near if row[_TOP] > 0.0 else far)
    # A pixel near straight down or up is wider in azimuth than on the horizon.
    level = max(1e-3, math.cos(max(abs(low), abs(high))))
    spread = math.asin(radius / distance) + margin_rad / level
    return math.atan2(row[_Y], row[_X]), min(spread, math.pi), low - margin_rad, high + margin_rad


@njit(cache=True)
def pixel_box(around: Outline, cells: np.ndarray) -> tuple[int, int, int, int]:
    """First and last row, first and last column of the pixels that look into an outline."""
    azimuth, spread, low, high = around
    first_azimuth = math.floor(((azimuth - spread) / math.pi + 1.0) * (AZIMUTHS // 2))
    last_azimuth = math.floor(((azimuth + spread) / math.pi + 1.0) * (AZIMUTHS // 2))
    first_elevation = max(0, int((low / math.pi + 0.5) * ELEVATIONS))
    last_elevation = min(ELEVATIONS - 1, int((high / math.pi + 0.5) * ELEVATIONS))
    top, bottom, left, right = 1 << 30, -1, 1 << 30, -1
    for i in range(first_azimuth, min(last_azimuth, first_azimuth + AZIMUTHS - 1) + 1):
        for j in range(first_elevation, last_elevation + 1):
            cell = cells[i % AZIMUTHS, j]
            top, bottom = min(top, cell[0]), max(bottom, cell[1])
            left, right = min(left, cell[2]), max(right, cell[3])
    return top, bottom, left, right


@njit(inline="always")
def looks_into(angles: np.ndarray, around: Outline) -> bool:
    """Whether a pixel's azimuth and elevation (2,) lie within an outline."""
    aside = abs(angles[0] - around[0])
    if min(aside, 2.0 * math.pi - aside) > around[1]:
        return False
    return around[2] <= angles[1] <= around[3]


@njit(cache=True, fastmath=True, error_model="numpy")
def hit(row: np.ndarray, dx: float, dy: float, dz: float) -> Hit:
    """Where a ray (dx, dy, dz) from the eye enters the solid; NO_HIT if it does not."""
    if row[_SHAPE] == 0:
        return _hit_box(row, dx, dy, dz)
    if row[_SHAPE] == 1:
        return _hit_cylinder(row, dx, dy, dz)
    return _hit_billboard(row, dx, dy, dz)


@njit(inline="always")
def _inverse(value: float) -> float:
    return 1.0 / value if abs(value) > 1e-12 else 1e12


@njit(fastmath=True, error_model="numpy")
def _hit_box(row: np.ndarray, dx: float, dy: float, dz: float) -> Hit:
    """Slabs (Kay and Kajiya 1986) in the box's own axes."""
    c, s = row[_COS], row[_SIN]
    across, along = _inverse(c * dx + s * dy), _inverse(c * dy - s * dx)
    x, y = c * row[_X] + s * row[_Y], c * row[_Y] - s * row[_X]
    half_x, half_y = math.copysign(row[_LENGTH], across), math.copysign(row[_WIDTH], along)
    up = _inverse(dz)
    lower, upper = (row[_BASE], row[_TOP]) if up > 0.0 else (row[_TOP], row[_BASE])
    in_x, in_y, in_z = (x - half_x) * across, (y - half_y) * along, lower * up
    out = min((x + half_x) * across, (y + half_y) * along, upper * up)
    enter = max(in_x, in_y, in_z)
    if enter <= 0.0 or enter > out:
        return NO_HIT, 0.0, 0.0, 0.0
    if enter == in_z:
        return enter, 0.0, 0.0, -math.copysign(1.0, up)
    if enter == in_x:
        sign = -math.copysign(1.0, across)
        return enter, sign * c, sign * s, 0.0
    sign = -math.copysign(1.0, along)
    return enter, -sign * s, sign * c, 0.0


@njit(fastmath=True, error_model="numpy")
def _hit_cylinder(row: np.ndarray, dx: float, dy: float, dz: float) -> Hit:
    x, y, radius = row[_X], row[_Y], row[_LENGTH]
    up = _inverse(dz)
    lower, upper = (row[_BASE], row[_TOP]) if up > 0.0 else (row[_TOP], row[_BASE])
    level = max(dx * dx + dy * dy, 1e-12)
    middle = (x * dx + y * dy) / level
    root = middle * middle - (x * x + y * y - radius * radius) / level
    if root < 0.0:
        return NO_HIT, 0.0, 0.0, 0.0
    half = math.sqrt(root)
    enter = max(middle - half, lower * up)
    if enter <= 0.0 or enter > min(middle + half, upper * up):
        return NO_HIT, 0.0, 0.0, 0.0
    if enter == lower * up:
        return enter, 0.0, 0.0, -math.copysign(1.0, up)
    return enter, (enter * dx - x) / radius, (enter * dy - y) / radius, 0.0


@njit(fastmath=True, error_model="numpy")
def _hit_billboard(row: np.ndarray, dx: float, dy: float, dz: float) -> Hit:
    """An upright rectangle that faces the eye."""
    distance = max(math.hypot(row[_X], row[_Y]), 1e-9)
    nx, ny = row[_X] / distance, row[_Y] / distance
    towards = dx * nx + dy * ny
    if towards < 1e-9:
        return NO_HIT, 0.0, 0.0, 0.0
    enter = distance / towards
    aside = abs(enter * (dx * ny - dy * nx))
    height = enter * dz
    if aside > row[_WIDTH] or height < row[_BASE] or height > row[_TOP]:
        return NO_HIT, 0.0, 0.0, 0.0
    return enter, -nx, -ny, 0.0
