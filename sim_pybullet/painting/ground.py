"""Paints the floor of a road map under a ``GroundLook``."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import cv2
import numpy as np

from robot.navigation.road_map import RoadMap
from robot.navigation.tiles import ROAD_SIDES, Tile
from sim_pybullet.classes import SemanticClass
from sim_pybullet.look import GroundLook
from sim_pybullet.painting.ground_kernel import compose
from sim_pybullet.painting.paint import tile_paint, tile_seam
from sim_pybullet.painting.shadows import cast_shadows
from sim_pybullet.painting.strip_ground import paint_strips
from sim_pybullet.scene import Ground

TEXEL_M = 0.0027  # aimed at; a tile is a whole number of texels, a multiple of 8
NOISE_SIZE_PX = 512  # the surface noise repeats after this many texels (1.4 m)
GRASS_RGB = (82.0, 118.0, 62.0)
MATS = (*ROAD_SIDES, "asphalt", "calibration_tile")  # kinds made of dark foam mats


@dataclass(frozen=True)
class Noise:
    """Fields that wrap around: unit-variance grain and wear ranks in [0, 1], float32."""

    grain: np.ndarray
    wear: np.ndarray


def paint_ground(road_map: RoadMap, look: GroundLook) -> Ground:
    """The floor of ``road_map``; the same arguments paint the same floor."""
    if look.painter == "strips":
        return paint_strips(road_map, look)
    size = 8 * max(1, round(road_map.tile_size_m / TEXEL_M / 8))
    painted = [[_painted_as(tile, road_map.compat) for tile in row] for row in road_map.tiles]
    names = sorted({name for row in painted for name in row})
    paints = np.stack(
        [np.rot90(tile_paint(kind, size, look.line_width_scale), turns) for kind, turns in names]
    )
    index = np.array([[names.index(name) for name in row] for row in painted])
    noise = surface_noise(look.texture_seed)
    rgb = compose(
        index,
        paints,
        np.array([_base_rgb(kind, look) for kind, _ in names], np.float32),
        np.array([look.white_rgb, look.yellow_rgb, look.red_rgb], np.float32),
        tile_seam(size) * np.float32(look.seam_depth),
        np.array([kind in MATS for kind, _ in names], np.float32),
        noise.grain * np.float32(look.grain),
        paint_left(noise, look),
        _light(index.shape, size, look),
    )
    base = np.array([SemanticClass.ROAD if k in MATS else SemanticClass.OUTSIDE for k, _ in names])
    texel_m = road_map.tile_size_m / size
    outside = tuple(min(255.0, look.brightness * value) for value in look.outside_rgb)
    return Ground(
        rgb=rgb,
        classes=_classes(paints, base)[index].swapaxes(1, 2).reshape(rgb.shape[:2]),
        texel_m=texel_m,
        west_m=0.0,
        north_m=len(road_map.tiles) * road_map.tile_size_m,
        outside_rgb=(outside[0], outside[1], outside[2]),
    )


def _painted_as(tile: Tile, compat: bool) -> tuple[str, int]:
    """Kind and quarter turns; the reference simulator takes both T-junctions for the left one."""
    kind = "3way_left" if compat and tile.kind == "3way_right" else tile.kind
    return kind, tile.quarter_turns % 4


def _base_rgb(kind: str, look: GroundLook) -> tuple[float, float, float]:
    if kind in MATS:
        return look.asphalt_rgb
    return GRASS_RGB if kind == "grass" else look.outside_rgb


def _classes(paints: np.ndarray, base: np.ndarray) -> np.ndarray:
    """Semantic class of each texel of each tile, (K, T, T) uint8: paint where it covers half."""
    classes = np.broadcast_to(base[:, None, None], paints.shape[:3]).astype(np.uint8)
    lines = (SemanticClass.WHITE_LINE, SemanticClass.YELLOW_LINE, SemanticClass.RED_LINE)
    for plane, line in enumerate(lines):
        classes[paints[..., plane] >= 128] = line
    return classes


@lru_cache(maxsize=16)
def surface_noise(seed: int) -> Noise:
    """The surface noise of one ``texture_seed``."""
    rng = np.random.default_rng(seed)
    fine = rng.standard_normal((NOISE_SIZE_PX, NOISE_SIZE_PX), np.float32)
    grain = _unit(_blur(fine, 1.2)) + 0.5 * _unit(_blur(fine[::-1], 6.0))
    scuffs = _unit(_blur(fine[:, ::-1], 3.0)) + 0.7 * _unit(_blur(fine.T, 12.0))
    ranks = 0.5 + 0.5 * np.tanh(0.8 * _unit(scuffs))  # close to the normal distribution function
    return Noise(_unit(grain), ranks.astype(np.float32))


def paint_left(noise: Noise, look: GroundLook) -> np.ndarray:
    """Share of the paint that wear has left, (NOISE_SIZE_PX, NOISE_SIZE_PX) float32."""
    if look.wear == 0.0:
        return np.ones_like(noise.wear)
    return np.clip((noise.wear - np.float32(0.5 * look.wear)) / np.float32(0.02), 0.0, 1.0)


def _blur(field: np.ndarray, sigma: float) -> np.ndarray:
    margin = math.ceil(4 * sigma)
    padded = np.pad(field, margin, mode="wrap")
    blurred = cv2.GaussianBlur(padded, (0, 0), sigma)
    return np.asarray(blurred)[margin:-margin, margin:-margin]


def _unit(field: np.ndarray) -> np.ndarray:
    return (field - field.mean()) / field.std()


def _light(tiles: tuple[int, ...], size: int, look: GroundLook) -> np.ndarray:
    """Brightness of the whole floor, (H, W) float32."""
    light = _patches(tiles, size, look)
    if look.shadows == 0.0:
        return light
    rng = np.random.default_rng((look.texture_seed, 2))
    return light * cast_shadows(light.shape, TEXEL_M, look.shadows, rng)


def _patches(tiles: tuple[int, ...], size: int, look: GroundLook) -> np.ndarray:
    """Brightness with its large soft light and dark areas, (H, W) float32."""
    rng = np.random.default_rng((look.texture_seed, 1))
    coarse = rng.uniform(-1.0, 1.0, (2 * tiles[0] + 1, 2 * tiles[1] + 1)).astype(np.float32)
    shape = (tiles[1] * size, tiles[0] * size)
    if look.patchiness == 0.0:
        return np.full(shape[::-1], look.brightness, np.float32)
    soft = cv2.resize(coarse, shape, interpolation=cv2.INTER_CUBIC)
    return np.asarray(look.brightness * (1.0 + 0.4 * look.patchiness * soft), np.float32)
