"""Paints the floor of a road map under a ``GroundLook``, from coverages of each kind of tile.

Tile frame (orientation S) of Duckietown maps: x to the right, z down, both in tiles from the tile's
centre, as seen from above. Traffic keeps right. Bands are those of the reference simulator's
textures, made even so that lines meet however tiles are turned; stop lines and corners lie as on
real mats.
"""

import math
from dataclasses import dataclass
from functools import lru_cache

import cv2
import numpy as np
from numba import njit, prange

from robot.geometry import bezier_points
from robot.navigation.road_map import ROAD_SIDES, RoadMap, Tile, tile_lanes
from sim_pybullet.look import GroundLook
from sim_pybullet.painting.shadows import cast_shadows
from sim_pybullet.painting.strip_ground import paint_strips
from sim_pybullet.scene import Ground, SemanticClass

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
    painted = [[(tile.kind, tile.quarter_turns % 4) for tile in row] for row in road_map.tiles]
    names = sorted({name for row in painted for name in row})
    index = np.array([[names.index(name) for name in row] for row in painted])
    paints = np.stack(
        [np.rot90(tile_paint(kind, size, look.line_width_scale), turns) for kind, turns in names]
    )
    on_mat = np.array([kind in MATS for kind, _ in names])
    base_rgb = {"grass": GRASS_RGB, **dict.fromkeys(MATS, look.asphalt_rgb)}
    noise = surface_noise(look.texture_seed)
    rgb = _compose(
        index,
        paints,
        np.array([base_rgb.get(kind, look.outside_rgb) for kind, _ in names], np.float32),
        np.array([look.white_rgb, look.yellow_rgb, look.red_rgb], np.float32),
        on_mat[:, None, None] * (tile_seam(size) * np.float32(look.seam_depth)),
        noise.grain * np.float32(look.grain),
        paint_left(noise, look),
        _light(index.shape, size, look),
    )
    classes = np.where(on_mat, SemanticClass.ROAD, SemanticClass.OUTSIDE).astype(np.uint8)
    classes = np.broadcast_to(classes[:, None, None], paints.shape[:3]).copy()
    lines = (SemanticClass.WHITE_LINE, SemanticClass.YELLOW_LINE, SemanticClass.RED_LINE)
    for plane, line in enumerate(lines):  # where paint covers half
        classes[paints[..., plane] >= 128] = line
    classes = classes[index].swapaxes(1, 2).reshape(rgb.shape[:2])
    north_m, texel_m = len(road_map.tiles) * road_map.tile_size_m, road_map.tile_size_m / size
    return Ground(rgb, classes, texel_m, 0.0, north_m, look.beyond_rgb)


@lru_cache(maxsize=16)
def surface_noise(seed: int) -> Noise:
    """The surface noise of one ``texture_seed``."""
    fine = np.random.default_rng(seed).standard_normal((NOISE_SIZE_PX, NOISE_SIZE_PX), np.float32)
    grain = _unit(_blur(fine, 1.2)) + 0.5 * _unit(_blur(fine[::-1], 6.0))
    scuffs = _unit(_blur(fine[:, ::-1], 3.0)) + 0.7 * _unit(_blur(fine.T, 12.0))
    ranks = 0.5 + 0.5 * np.tanh(0.8 * _unit(scuffs))  # close to the normal distribution function
    return Noise(_unit(grain), ranks.astype(np.float32))


def paint_left(noise: Noise, look: GroundLook) -> np.ndarray:
    """Share of the paint that wear and gaps have left, (NOISE_SIZE_PX, NOISE_SIZE_PX) float32."""
    left = np.ones_like(noise.wear)
    if look.wear > 0.0:
        left = np.clip((noise.wear - np.float32(0.5 * look.wear)) / np.float32(0.02), 0.0, 1.0)
    if look.gaps > 0.0:
        stretches = _blur(noise.grain[:, ::-1], 24.0)
        left = left * (stretches > np.quantile(stretches, look.gaps))
    return left


def _blur(field: np.ndarray, sigma: float) -> np.ndarray:
    margin = math.ceil(4 * sigma)
    blurred = cv2.GaussianBlur(np.pad(field, margin, mode="wrap"), (0, 0), sigma)
    return np.asarray(blurred)[margin:-margin, margin:-margin]


def _unit(field: np.ndarray) -> np.ndarray:
    return (field - field.mean()) / field.std()


def soft_light(cells: tuple[int, int], shape: tuple[int, ...], look: GroundLook) -> np.ndarray:
    """Brightness with its large soft light and dark areas, drawn as cells, (H, W) float32."""
    if look.patchiness == 0.0:
        return np.full(shape, look.brightness, np.float32)
    rng = np.random.default_rng((look.texture_seed, 1))
    soft = rng.uniform(-1.0, 1.0, cells).astype(np.float32)
    soft = np.asarray(cv2.resize(soft, shape[1::-1], interpolation=cv2.INTER_CUBIC))
    return np.asarray(look.brightness * (1.0 + 0.4 * look.patchiness * soft), np.float32)


def _light(tiles: tuple[int, ...], size: int, look: GroundLook) -> np.ndarray:
    """Brightness of the whole floor, (H, W) float32."""
    shape = (tiles[0] * size, tiles[1] * size)
    light = soft_light((2 * tiles[0] + 1, 2 * tiles[1] + 1), shape, look)
    if look.shadows == 0.0:
        return light
    rng = np.random.default_rng((look.texture_seed, 2))
    return light * cast_shadows(shape, TEXEL_M, look.shadows, rng)


@njit(parallel=True, nogil=True, cache=True, fastmath=True)
def _compose(
    index: np.ndarray,  # (rows, columns) integers, which of the K tile pictures lies where
    paints: np.ndarray,  # (K, T, T, 3) uint8 coverage of the three paints
    bases: np.ndarray,  # (K, 3) float32, ground of each tile
    colours: np.ndarray,  # (3, 3) float32, colour of each paint
    seams: np.ndarray,  # (K, T, T) float32, darkening at the joints [grey levels]
    grain: np.ndarray,  # (S, S) float32, S a power of two: noise [grey levels]
    kept: np.ndarray,  # (S, S) float32: share of paint left
    brightness: np.ndarray,  # (rows * T, columns * T) float32 factor
) -> np.ndarray:
    """Asphalt, joints, paint and wear over each other: (rows * T, columns * T, 3) uint8 RGB."""
    size = paints.shape[1]
    mask = grain.shape[0] - 1
    height, width = brightness.shape
    rgb = np.empty((height, width, 3), np.uint8)
    for row in prange(height):
        v = row % size
        for column in range(width):
            u = column % size
            tile = index[row // size, column // size]
            noise = grain[row & mask, column & mask] - seams[tile, v, u]
            left = kept[row & mask, column & mask] / np.float32(255.0)
            white = paints[tile, v, u, 0] * left
            yellow = paints[tile, v, u, 1] * left
            red = paints[tile, v, u, 2] * left
            bare = np.float32(1.0) - white - yellow - red
            noise *= np.float32(0.4) + np.float32(0.6) * bare  # tape is smoother than foam
            for c in range(3):
                paint = white * colours[0, c] + yellow * colours[1, c] + red * colours[2, c]
                value = bare * bases[tile, c] + paint + noise
                value = value * brightness[row, column] + np.float32(0.5)
                rgb[row, column, c] = np.uint8(min(max(value, np.float32(0.0)), np.float32(255.0)))
    return rgb


WHITE, YELLOW, RED = 0, 1, 2  # planes of a tile's paint

WHITE_BAND = (0.025, 0.111)  # from the tile's edge, in tiles
FAR_WHITE_BAND = (0.889, 0.975)
YELLOW_BAND = (0.479, 0.521)
RED_DEPTH = 0.075  # of a stop line, along the lane
DASHES_PER_TILE = 8
DASH_SHARE = 0.64  # 4.7 cm of paint, 2.6 cm of gap on a 0.585 m tile
TOOTH_PITCH = 0.1  # of the joints between foam mats, in tiles
TOOTH_HEIGHT = 0.02
SEAM_WIDTH = 0.009


@lru_cache(maxsize=64)
def tile_paint(kind: str, size_px: int, width_scale: float) -> np.ndarray:
    """Coverage (size, size, 3) uint8 of white, yellow and red paint; zero for unpainted kinds.

    A ``3way_right`` is a ``3way_left`` turned twice (its side road leaves to the other side).
    """
    planes = np.zeros((size_px, size_px, 3), np.float32)
    x, z = _grid(size_px)
    if kind == "straight":
        _lane_markings(planes, x + 0.5, z + 0.5, DASHES_PER_TILE, width_scale)
    elif kind == "curve_left":
        _curve(planes, x, z, width_scale)
    elif kind == "curve_right":
        return np.ascontiguousarray(tile_paint("curve_left", size_px, width_scale)[:, ::-1])
    elif kind == "3way_left":
        planes[..., WHITE] = _band(x + 0.5, WHITE_BAND, width_scale, size_px)
        _junction(planes, x, z, width_scale, (0, 2, 3))
    elif kind == "3way_right":
        return np.ascontiguousarray(tile_paint("3way_left", size_px, width_scale)[::-1, ::-1])
    elif kind == "4way":
        _junction(planes, x, z, width_scale, (0, 1, 2, 3))
    return np.round(255.0 * np.clip(planes, 0.0, 1.0)).astype(np.uint8)


@lru_cache(maxsize=8)
def tile_seam(size_px: int) -> np.ndarray:
    """Coverage (size, size) float32 of the interlocking joints around one foam mat."""
    x, z = _grid(size_px)
    seam = np.zeros((size_px, size_px), np.float32)
    for across, along in ((x, z), (z, x)):
        teeth = 0.5 * TOOTH_HEIGHT * np.sign(np.sin(2.0 * np.pi * along / TOOTH_PITCH))
        for edge in (-0.5, 0.5):
            distance = np.abs(across - edge - teeth) * size_px
            seam = np.maximum(seam, np.clip(0.5 + 0.5 * SEAM_WIDTH * size_px - distance, 0, 1))
    return seam


def _grid(size_px: int) -> tuple[np.ndarray, np.ndarray]:
    centres = ((np.arange(size_px) + 0.5) / size_px - 0.5).astype(np.float32)
    x, z = np.meshgrid(centres, centres)
    return x, z


def _band(along: np.ndarray, band: tuple[float, float], scale: float, size_px: int) -> np.ndarray:
    """Anti-aliased membership of a band, widened about its middle."""
    middle, half = 0.5 * (band[0] + band[1]), 0.5 * scale * (band[1] - band[0])
    return np.clip(0.5 + (half - np.abs(along - middle)) * size_px, 0.0, 1.0)


def _lane_markings(
    planes: np.ndarray, across: np.ndarray, along: np.ndarray, dashes: int, scale: float
) -> None:
    """Two white edges and a dashed yellow middle; ``along`` runs from 0 to 1 over the tile."""
    size = len(planes)
    edges = (_band(across, band, scale, size) for band in (WHITE_BAND, FAR_WHITE_BAND))
    planes[..., WHITE] = np.maximum(*edges)
    phase = np.abs((along * dashes) % 1.0 - 0.5)
    dash = np.clip(0.5 + (0.5 * DASH_SHARE - phase) * size / dashes, 0.0, 1.0)
    planes[..., YELLOW] = np.minimum(_band(across, YELLOW_BAND, scale, size), dash)


def _curve(planes: np.ndarray, x: np.ndarray, z: np.ndarray, scale: float) -> None:
    """The markings bent so that both lanes' Beziers run in the middle between their lines."""
    radius, angle = np.hypot(0.5 - x, z + 0.5), np.arctan2(z + 0.5, 0.5 - x)
    lanes = tile_lanes(Tile("curve_left", 0, 0, 0), 1.0, 1)
    outer, inner = (_polar_radius(lane.control_points_m - 0.5, angle) for lane in lanes)
    between, beyond = 0.3 + 0.4 * (radius - inner) / (outer - inner), 0.7 + radius - outer
    parts = (0.3 * radius / inner, between)
    across = np.select((radius < inner, radius < outer), parts, beyond)
    _lane_markings(planes, across, angle / (0.5 * np.pi), 6, scale)


def _polar_radius(lane: np.ndarray, angle: np.ndarray) -> np.ndarray:
    """Distance of a lane (4, 2), x east and y north, from the tile's north-east corner."""
    points = bezier_points(lane, np.linspace(0.0, 1.0, 200))
    dx, dz = 0.5 - points[:, 0], 0.5 - points[:, 1]
    angles, radii = np.arctan2(dz, dx), np.hypot(dx, dz)
    order = np.argsort(angles)
    return np.interp(angle, angles[order], radii[order]).astype(np.float32)


def _junction(
    planes: np.ndarray, x: np.ndarray, z: np.ndarray, scale: float, sides: tuple[int, ...]
) -> None:
    """Stop lines on the open sides, counted counter-clockwise from the north, and white pieces in
    the corners between two of them."""
    size = len(planes)
    across = np.minimum(
        _band(x, (WHITE_BAND[1] - 0.5, YELLOW_BAND[0] - 0.5), 1.0, size),
        _band(z + 0.5, (-RED_DEPTH, RED_DEPTH), scale, size),
    )
    corner = _band(np.hypot(x - 0.5, z + 0.5), WHITE_BAND, scale, size)
    for side in sides:
        planes[..., RED] = np.maximum(planes[..., RED], np.rot90(across, side))
        if (side - 1) % 4 in sides:
            planes[..., WHITE] = np.maximum(planes[..., WHITE], np.rot90(corner, side))
