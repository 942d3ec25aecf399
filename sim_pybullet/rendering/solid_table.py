"""Solids as rows of numbers, and where in a picture to look for what lies in which direction."""

import math
from functools import lru_cache

import numpy as np

from robot.contract import ImageSpec
from robot.lens import CameraRig
from sim_pybullet.look import LightLook
from sim_pybullet.rendering.rays import pixel_rays
from sim_pybullet.scene import Solid

AZIMUTHS, ELEVATIONS = 120, 60  # cells of 3 by 3 degrees


def solid_rows(solids: tuple[Solid, ...]) -> np.ndarray:
    """(K, 13) float64, one row per solid in the world frame; columns: `solid_geometry`."""
    rows = [
        (
            solid.x_m,
            solid.y_m,
            math.cos(solid.heading_rad),
            math.sin(solid.heading_rad),
            0.5 * solid.size_m[0],
            0.5 * solid.size_m[1] * (solid.shape == "box"),
            solid.base_m,
            solid.base_m + solid.size_m[2],
            solid.shape == "cylinder",
            int(solid.kind),
            *solid.rgb,
        )
        for solid in solids
    ]
    return np.array(rows, dtype=np.float64).reshape(len(solids), 13)


def light_row(light: LightLook) -> np.ndarray:
    """(5,): unit vector to the light in the world frame, ambient and diffuse share."""
    level = math.cos(light.elevation_rad)
    direction = (level * math.cos(light.azimuth_rad), level * math.sin(light.azimuth_rad))
    return np.array((*direction, math.sin(light.elevation_rad), light.ambient, light.diffuse))


@lru_cache(maxsize=256)
def direction_table(rig: CameraRig, image: ImageSpec) -> tuple[np.ndarray, float]:
    """Which way a rig's pixels look in the robot frame, to find those that look at something.

    Cells (AZIMUTHS, ELEVATIONS, 4) int16: first and last row, first and last column of the pixels
    that look into each, one pixel more on each side; an empty one has first above last. Azimuths
    count from behind, elevations from straight down. And the width of the widest pixel [rad].
    """
    rays = pixel_rays(rig, image)
    d = rays.directions
    azimuth, elevation = np.arctan2(d[..., 1], d[..., 0]), np.arcsin(np.clip(d[..., 2], -1.0, 1.0))
    i = ((azimuth[rays.seen] / math.pi + 1.0) * (AZIMUTHS // 2)).astype(int) % AZIMUTHS
    j = ((elevation[rays.seen] / math.pi + 0.5) * ELEVATIONS).astype(int)
    cell = i * ELEVATIONS + np.minimum(j, ELEVATIONS - 1)
    rows, columns = np.nonzero(rays.seen)
    bounds = np.empty((AZIMUTHS * ELEVATIONS, 4), np.int64)
    bounds[:, 0::2], bounds[:, 1::2] = np.iinfo(np.int16).max, -1
    for k, positions in ((0, rows), (2, columns)):
        np.minimum.at(bounds[:, k], cell, positions - 1)
        np.maximum.at(bounds[:, k + 1], cell, positions + 1)
    last = np.array(rays.seen.shape) - 1
    bounds[:, 0::2] = np.maximum(bounds[:, 0::2], 0)
    bounds[:, 1::2] = np.minimum(bounds[:, 1::2], last)
    steps = [np.linalg.norm(np.diff(d, axis=k), axis=-1).max(initial=0.0) for k in (0, 1)]
    return bounds.reshape(AZIMUTHS, ELEVATIONS, 4).astype(np.int16), float(max(steps))
