"""Where each pixel of a camera looks, worked out once per rig: rays, floor points, filters, sky.

And where in a picture to look for what lies in which direction.
"""

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple
from weakref import WeakKeyDictionary

import numpy as np

from robot.contract import ImageSpec
from robot.lens import CameraRig, Lens
from sim_pybullet.look import LightLook, SkyLook
from sim_pybullet.scene import Scene, SemanticClass

LEVELS = 8  # of the floor's mip pyramid
AZIMUTHS, ELEVATIONS = 120, 60  # cells of 3 by 3 degrees, of `direction_table`
MAX_TAPS = 4  # samples along a pixel's longer axis on the floor
NEAREST_HORIZON = 1e-3  # rays less steep than this meet the floor as if they were this steep
FINEST = 1.4  # [texels] narrower pixels count as this wide
LOD_BIAS = -0.5  # bilinear interpolation blurs by itself: a slightly finer level looks the same
Background = tuple[np.ndarray, np.ndarray]  # colours (3 P,) and classes (P,), both uint8
_KEPT: WeakKeyDictionary[Scene, dict[tuple[CameraRig, ImageSpec], Background]] = WeakKeyDictionary()


@dataclass(frozen=True)
class PixelRays:
    """Where the pixels of a picture look, in the robot frame."""

    directions: np.ndarray  # (H, W, 3) float32, unit; straight up where nothing is seen
    seen: np.ndarray  # (H, W) bool: the lens has such a pixel


class FloorTable(NamedTuple):
    """The floor points of P = H * W pixels, in texels of the mip level that each is read from.

    A pixel averages ``taps`` samples at (x + k * dx, y + k * dy), k = 0, 1, …: robot frame, x
    forward and y left. What no run covers is sky.
    """

    points: np.ndarray  # (4, P) float32: x, y, dx, dy
    runs: np.ndarray  # (R, 4) int32: first pixel of a row, last one + 1, level, log2(taps)
    first_run: np.ndarray  # row r has the runs first_run[r]..first_run[r + 1]


@lru_cache(maxsize=256)
def pixel_rays(rig: CameraRig, image: ImageSpec) -> PixelRays:
    """The rays of the picture's pixels: the rig's lens read out at the picture's size, cropped."""
    rays, seen = _lens_rays(rig.lens, image)
    directions = np.where(seen[..., None], rays @ rig.mount.rotation.T, (0.0, 0.0, 1.0))
    directions = directions.astype(np.float32)
    directions.setflags(write=False)
    return PixelRays(directions, seen)


@lru_cache(maxsize=16)  # of rigs that differ in their mount alone
def _lens_rays(lens: Lens, image: ImageSpec) -> tuple[np.ndarray, np.ndarray]:
    """Rays (H, W, 3) in the camera's frame, and where the lens has such a pixel (H, W)."""
    lens = lens.scaled(image.width_px, image.height_px)
    v, u = np.mgrid[image.crop_top_px : image.height_px, 0 : image.width_px]
    pixels = np.stack((u, v), axis=-1).astype(np.float64)
    rays = lens.unproject(pixels)
    error = np.abs(lens.project(rays) - pixels).max(axis=-1)
    return rays, np.isfinite(rays).all(axis=-1) & (error < 0.5)


@lru_cache(maxsize=256)
def floor_table(rig: CameraRig, image: ImageSpec, texel_m: float) -> FloorTable:
    """Floor points and filters of a rig over a floor of this texel size [m]."""
    rays = pixel_rays(rig, image)
    at = np.asarray(rig.mount.position_m) / texel_m
    points, longer, long_px, short_px = _footprints(rays.directions, float(at[2]))
    points += at[:2]
    needed = long_px / np.maximum(short_px, FINEST)  # the finest level blurs by a texel anyway
    taps = np.exp2(np.ceil(np.log2(np.clip(needed, 1.0, MAX_TAPS)) - 0.5))
    level = np.round(np.log2(np.maximum(short_px, long_px / taps)) + LOD_BIAS)
    level = np.clip(level, 0, LEVELS - 1)
    step = longer / taps[..., None]
    start = points - 0.5 * (taps[..., None] - 1.0) * step
    taken = np.concatenate((start, step), axis=-1) * np.exp2(-level)[..., None]
    floor = (horizon_share(rays) == 1.0) & rays.seen
    runs, first_run = _runs(floor, level.astype(np.int32), np.log2(taps).astype(np.int32))
    return FloorTable(taken.reshape(-1, 4).T.astype(np.float32, order="C"), runs, first_run)


def _footprints(
    directions: np.ndarray, height: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Floor point, longer axis (both (H, W, 2)) and both axes' lengths (H, W) of each pixel. The
    pixel's square maps to a parallelogram J [0, 1]^2; its axes are J's singular values (Heckbert
    1989, Fundamentals of Texture Mapping, 3.5). In units of ``height``."""
    down = np.minimum(directions[..., 2], -NEAREST_HORIZON)[..., None]
    points = directions[..., :2] / -down * height
    edges = []
    for axis in (1, 0):
        slope = np.gradient(directions, axis=axis) if directions.shape[axis] > 1 else directions * 0
        edges.append((slope[..., :2] - directions[..., :2] * slope[..., 2:] / down) / -down)
    (a, c), (b, d) = (np.moveaxis(edge * height, -1, 0) for edge in edges)
    sums, difference = a * a + b * b + c * c + d * d, a * a + b * b - c * c - d * d
    cross = a * c + b * d
    root = np.hypot(difference, 2.0 * cross)
    long_px = np.sqrt(0.5 * (sums + root))
    short_px = np.sqrt(np.maximum(0.5 * (sums - root), 1e-12))
    angle = 0.5 * np.arctan2(2.0 * cross, difference)
    longer = np.stack((np.cos(angle), np.sin(angle)), axis=-1) * long_px[..., None]
    return points, longer, long_px, short_px


def _runs(floor: np.ndarray, level: np.ndarray, taps: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    height, width = floor.shape
    code = np.where(floor, level * 8 + taps, -1)
    starts = np.ones_like(floor)
    starts[:, 1:] = code[:, 1:] != code[:, :-1]
    first = np.flatnonzero(starts)
    last = np.append(first[1:], height * width)
    kept = code.ravel()[first] >= 0
    first, last = first[kept], last[kept]
    value = code.ravel()[first]
    runs = np.stack((first, last, value // 8, value % 8), axis=-1).astype(np.int32)
    return runs, np.searchsorted(first, np.arange(height + 1) * width).astype(np.int32)


def horizon_share(rays: PixelRays) -> np.ndarray:
    """Part of each pixel (H, W) below the horizon: between 0 and 1 only for those that it cuts."""
    rise = rays.directions[..., 2]
    slopes = [np.gradient(rise, axis=k) if rise.shape[k] > 1 else 0.0 * rise for k in (0, 1)]
    return np.clip(0.5 - rise / np.maximum(np.hypot(*slopes), 1e-9), 0.0, 1.0)


def floor_shade(light: LightLook) -> float:
    """Brightness of the level floor under the far light (Lambert's law)."""
    return light.ambient + light.diffuse * max(0.0, math.sin(light.elevation_rad))


def sky_rgb(directions: np.ndarray, sky: SkyLook) -> np.ndarray:
    """(..., 3) uint8 of unit directions (..., 3): from the horizon's colour to the zenith's."""
    share = np.sqrt(np.clip(directions[..., 2:], 0.0, 1.0))
    rgb = (1.0 - share) * np.array(sky.horizon_rgb) + share * np.array(sky.zenith_rgb)
    return np.round(rgb).astype(np.uint8)


def background(rig: CameraRig, image: ImageSpec, scene: Scene) -> Background:
    """What pixels show that are not all floor; kept as long as the scene lives.

    A pixel that the horizon cuts blends the sky with the floor far away; one beyond the lens is
    black and counts as sky.
    """
    kept = _KEPT.setdefault(scene, {})
    if (rig, image) not in kept:
        rays = pixel_rays(rig, image)
        share = horizon_share(rays)[..., None]
        far = np.minimum(np.array(scene.ground.outside_rgb) * floor_shade(scene.light), 255.0)
        rgb = (1.0 - share) * sky_rgb(rays.directions, scene.sky) + share * far
        rgb = np.round(np.where(rays.seen[..., None], rgb, 0.0)).astype(np.uint8)
        below = (rays.directions[..., 2] < 0.0) & rays.seen
        kinds = np.where(below, SemanticClass.OUTSIDE, SemanticClass.SKY).astype(np.uint8)
        kept[rig, image] = rgb.ravel(), kinds.ravel()
    return kept[rig, image]


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
