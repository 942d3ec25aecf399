"""Light that goes astray on its way to the sensor: smears, and lamps in the floor."""

from __future__ import annotations

import math
from typing import Any

import cv2
import numpy as np
from numba import njit, prange, types
from numba.extending import intrinsic

from robot.contract import FRAME_WIDTH_PX, ImageSpec
from robot.lens import DUCKIEBOT_LENS, CameraRig
from sim_pybullet.look import LightLook
from sim_pybullet.rendering.rays import pixel_rays

# A turn by one radian moves the middle of a 160 px wide frame by so many pixels.
PX_PER_RAD = DUCKIEBOT_LENS.fx_px * FRAME_WIDTH_PX / DUCKIEBOT_LENS.width_px
_SMALLEST_SMEAR_PX = 0.3
_LAMP = 200.0  # grey levels of a lamp that the floor mirrors fully
_BARELY = 1e-3


def _fused(_context: Any, _a: Any, _b: Any, _c: Any) -> Any:
    """a b + c with one rounding, on every processor."""

    def generate(_: Any, builder: Any, __: Any, arguments: Any) -> Any:
        return builder.fma(*arguments)

    return types.float32(types.float32, types.float32, types.float32), generate


fma: Any = intrinsic(_fused)


def smeared(frames: np.ndarray, lengths_px: np.ndarray) -> np.ndarray:
    """Frames (N, H, W, 3) averaged over so many pixels along the rows, one length per frame.

    A robot on the floor turns about the vertical, so that its picture moves sideways.
    """
    if not (lengths_px > _SMALLEST_SMEAR_PX).any():
        return frames
    seen = frames.copy()
    for k in np.flatnonzero(lengths_px > _SMALLEST_SMEAR_PX):
        half = int(np.ceil(0.5 * lengths_px[k]))
        offsets = np.abs(np.arange(-half, half + 1))
        weights = np.clip(0.5 * lengths_px[k] + 0.5 - offsets, 0.0, 1.0)[None]
        seen[k] = cv2.filter2D(
            frames[k], -1, weights / weights.sum(), borderType=cv2.BORDER_REPLICATE
        )
    return seen


class Gloss:
    """The light's mirror image in the floors of N robots.

    Phong's model: the spot lies where a ray mirrored by the floor meets the light. Solids are not
    told from the floor: the spot lies over them.
    """

    def __init__(self, n_robots: int, image: ImageSpec) -> None:
        height, width, _ = image.shape
        self._image = image
        self._rigs: list[CameraRig | None] = [None] * n_robots
        self._rays = np.zeros((0, 3, height * width), np.float32)  # none until a floor is glossy
        self._lights = np.zeros((n_robots, 4))  # azimuth, elevation [rad], gloss, width [rad]

    def put(self, i: int, rig: CameraRig, light: LightLook) -> None:
        """Robot ``i`` sees this light, whose direction is in the world frame, through this rig."""
        elevation, width = light.elevation_rad, light.gloss_width_rad
        self._lights[i] = light.azimuth_rad, elevation, light.gloss, width
        if light.gloss and self._rigs[i] != rig:
            if not len(self._rays):
                self._rays = np.zeros((len(self._rigs), *self._rays.shape[1:]), np.float32)
            directions = pixel_rays(rig, self._image).directions
            self._rays[i] = np.moveaxis(directions, -1, 0).reshape(3, -1)
            self._rigs[i] = rig

    def add(self, frames: np.ndarray, headings: np.ndarray, robots: np.ndarray) -> None:
        """To frames (M, H, W, 3) uint8 of robots (M,) at headings (M,) [rad], in place."""
        azimuth, elevation, gloss, width = self._lights[robots].T
        lit = np.flatnonzero(gloss)
        if not len(lit):
            return
        ahead, level = (azimuth - headings)[lit], np.cos(elevation[lit])
        towards = (level * np.cos(ahead), level * np.sin(ahead), -np.sin(elevation[lit]))
        lamps = np.stack(towards, axis=1).astype(np.float32)
        variance = width[lit] ** 2
        least = (1.0 + variance * math.log(_BARELY)).astype(np.float32)
        spots = _distances(self._rays, robots[lit], lamps, least, variance.astype(np.float32))
        np.exp(spots, out=spots)
        strength = (gloss[lit] * _LAMP).astype(np.float32)
        _brighten(frames.reshape(len(frames), -1), lit, spots, strength)


@njit(parallel=True, nogil=True, cache=True)
def _distances(
    rays: np.ndarray, robots: np.ndarray, lamps: np.ndarray, least: np.ndarray, variance: np.ndarray
) -> np.ndarray:
    """The exponents (M, P) of the spots of lamps (M, 3); -inf where there is no spot."""
    found = np.empty((len(robots), rays.shape[2]), np.float32)
    one, nothing = np.float32(1.0), np.float32(-np.inf)
    for m in prange(len(robots)):
        x, y, z = rays[robots[m]]
        a, b, c = lamps[m]
        for p in range(len(x)):
            alike = fma(z[p], c, fma(y[p], b, x[p] * a))
            alike = min(max(alike, -one), one)
            seen = (alike > least[m]) & (z[p] < np.float32(0.0))
            found[m, p] = (alike - one) / variance[m] if seen else nothing
    return found


@njit(parallel=True, nogil=True, cache=True)
def _brighten(
    frames: np.ndarray, robots: np.ndarray, spots: np.ndarray, strength: np.ndarray
) -> None:
    half, most = np.float32(0.5), np.float32(255.0)
    for m in prange(len(robots)):
        frame = frames[robots[m]]
        for p in range(spots.shape[1]):
            if spots[m, p] > np.float32(0.0):
                for k in range(3 * p, 3 * p + 3):
                    bright = np.float32(frame[k]) + strength[m] * spots[m, p]
                    frame[k] = np.uint8(np.int32(min(bright + half, most)))
