"""What is painted on one tile of each kind, as coverages, in the tile frame of Duckietown maps.

Tile frame (orientation S): x to the right, z down, both in tiles from the tile's centre, as seen
from above. Traffic keeps right. Bands are those of the reference simulator's textures, made even
so that lines meet however tiles are turned; stop lines and corners lie as on real mats.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from robot.geometry import bezier_points
from robot.navigation.lanes import tile_lanes
from robot.navigation.tiles import Tile

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
        _junction(planes, x, z, width_scale, sides=(0, 2, 3), corners=(0, 3))
    elif kind == "3way_right":
        return np.ascontiguousarray(tile_paint("3way_left", size_px, width_scale)[::-1, ::-1])
    elif kind == "4way":
        _junction(planes, x, z, width_scale, sides=(0, 1, 2, 3), corners=(0, 1, 2, 3))
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


def _band(
    position: np.ndarray, band: tuple[float, float], scale: float, size_px: int
) -> np.ndarray:
    """Anti-aliased membership of a band, widened about its middle."""
    middle, half = 0.5 * (band[0] + band[1]), 0.5 * scale * (band[1] - band[0])
    return np.clip(0.5 + (half - np.abs(position - middle)) * size_px, 0.0, 1.0)


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
    across = np.where(
        radius < inner,
        0.3 * radius / inner,
        np.where(
            radius < outer, 0.3 + 0.4 * (radius - inner) / (outer - inner), 0.7 + radius - outer
        ),
    )
    _lane_markings(planes, across, angle / (0.5 * np.pi), 6, scale)


def _polar_radius(lane: np.ndarray, angle: np.ndarray) -> np.ndarray:
    """Distance of a lane (4, 2), x east and y north, from the tile's north-east corner."""
    points = bezier_points(lane, np.linspace(0.0, 1.0, 200))
    dx, dz = 0.5 - points[:, 0], 0.5 - points[:, 1]
    angles, radii = np.arctan2(dz, dx), np.hypot(dx, dz)
    order = np.argsort(angles)
    return np.interp(angle, angles[order], radii[order]).astype(np.float32)


def _junction(
    planes: np.ndarray,
    x: np.ndarray,
    z: np.ndarray,
    scale: float,
    sides: tuple[int, ...],
    corners: tuple[int, ...],
) -> None:
    """Stop lines on the open sides and white corner pieces, counted counter-clockwise.

    Side 0 is the north one; corner 0 is the north-east one.
    """
    size = len(planes)
    across = np.minimum(
        _band(x, (WHITE_BAND[1] - 0.5, YELLOW_BAND[0] - 0.5), 1.0, size),
        _band(z + 0.5, (-RED_DEPTH, RED_DEPTH), scale, size),
    )
    corner = _band(np.hypot(x - 0.5, z + 0.5), WHITE_BAND, scale, size)
    for turns in sides:
        planes[..., RED] = np.maximum(planes[..., RED], np.rot90(across, turns))
    for turns in corners:
        planes[..., WHITE] = np.maximum(planes[..., WHITE], np.rot90(corner, turns))
