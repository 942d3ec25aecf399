"""Paints the ground of a race track under a ``Look``: road, lines, kerbs, grass, landscape."""

from __future__ import annotations

import math
from functools import lru_cache
from typing import NamedTuple

import cv2
import numpy as np

from sim_pybullet.look import GroundLook, Look
from sim_pybullet.painting.ground import paint_left, surface_noise
from sim_pybullet.racing.track import SCALE, SPACING_M, CentreLine, Track, centre_line
from sim_pybullet.racing.track_kernel import lay, locate
from sim_pybullet.scene import Ground

MOST_TEXELS = 6_000_000  # of a track's floor; 9 bytes each when packed
FINEST_TEXEL_M = 0.0054
# Of the real track:
LINE_M = 0.35  # white edge line
KERB_M = 1.0
# What repeats along a track is to tell a car's speed. At 25 m/s it drives 2.5 m between two
# pictures, a quarter of these periods; what repeats every 4 m would seem to stand still.
STONE_M = 5.0  # a kerb changes its colour so often
KERB_RADIUS_M = 120.0  # wider bends have no kerbs
KERB_BEFORE_M = 5  # they begin so early, and end so late
CENTRE_LINE_M = 0.3
_PATCH_M = 0.3  # of the world: size of light and dark areas


class TrackField(NamedTuple):
    """Where each texel of a track's floor is: (H, W) float32 each, in metres of the world."""

    offset_m: np.ndarray  # from the centre line, positive to the left; 1e9 where it is far away
    arc_m: np.ndarray  # along it
    texel_m: float


def paint_track(track: Track, look: Look) -> Ground:
    """The ground of ``track``; the same arguments paint the same ground.

    Raises:
        ConfigError: the track is not closed.
    """
    line, field = centre_line(track), track_field(track)
    ground = look.ground
    noise = surface_noise(ground.texture_seed)
    rgb, classes = lay(
        field.offset_m,
        field.arc_m,
        _bends(line.curvature),
        _colours(look),
        _sizes(line, look, field.texel_m),
        noise.grain * np.float32(ground.grain),
        paint_left(noise, ground),
        _brightness(field.offset_m.shape, field.texel_m, ground),
    )
    outside = tuple(min(255.0, ground.brightness * value) for value in ground.outside_rgb)
    return Ground(
        rgb=rgb,
        classes=classes,
        texel_m=field.texel_m,
        west_m=0.0,
        north_m=classes.shape[0] * field.texel_m,
        outside_rgb=(outside[0], outside[1], outside[2]),
    )


@lru_cache(maxsize=2)
def track_field(track: Track) -> TrackField:
    """Worked out once for all the looks of a track."""
    line = centre_line(track)
    east_m, north_m = line.size_m
    texel_m = max(FINEST_TEXEL_M, math.sqrt(east_m * north_m / MOST_TEXELS))
    shape = (math.ceil(north_m / texel_m), math.ceil(east_m / texel_m))
    path = line.path
    points = np.column_stack((path.points_m, path.headings_rad, path.arc_m))
    reach_m = line.half_width_m + line.verge_m + SPACING_M * SCALE
    offset_m, arc_m = locate(points, shape, shape[0] * texel_m, texel_m, reach_m)
    return TrackField(offset_m, arc_m, texel_m)


def _bends(curvature: np.ndarray) -> np.ndarray:
    """(M,) bool: whether a point of the centre line is in a bend, or just before or after one."""
    bend = np.abs(curvature) * SCALE > 1.0 / KERB_RADIUS_M
    before = np.stack([np.roll(bend, k) for k in range(-KERB_BEFORE_M, KERB_BEFORE_M + 1)])
    return np.asarray(before.any(axis=0))


def _colours(look: Look) -> np.ndarray:
    ground, track = look.ground, look.track
    return np.array(
        [
            ground.asphalt_rgb,
            track.grass_rgb,
            ground.outside_rgb,
            track.kerb_rgb,
            track.kerb_2_rgb,
            ground.white_rgb,
            ground.yellow_rgb,
        ],
        np.float32,
    )


def _sizes(line: CentreLine, look: Look, texel_m: float) -> np.ndarray:
    """See `sim_pybullet.racing.track_kernel.lay`; all lengths in metres of the world."""
    wide = look.ground.line_width_scale
    real = (LINE_M * wide, KERB_M, STONE_M, CENTRE_LINE_M * wide, look.track.dashes_m)
    edge, kerb, stone, middle, period = (SCALE * value for value in real)
    spacing = line.path.length_m / len(line.curvature)
    road = (line.half_width_m, line.verge_m, edge, kerb, stone, middle, period)
    return np.array((*road, look.track.centre_line, spacing, texel_m))


def _brightness(shape: tuple[int, ...], texel_m: float, look: GroundLook) -> np.ndarray:
    """The floor's brightness with its large soft light and dark areas, (H, W) or (1, 1) float32."""
    if look.patchiness == 0.0:
        return np.full((1, 1), look.brightness, np.float32)
    rng = np.random.default_rng((look.texture_seed, 1))
    coarse = [math.ceil(side * texel_m / _PATCH_M) + 1 for side in shape[:2]]
    soft = rng.uniform(-1.0, 1.0, coarse).astype(np.float32)
    soft = np.asarray(cv2.resize(soft, shape[1::-1], interpolation=cv2.INTER_CUBIC))
    return np.asarray(look.brightness * (1.0 + 0.4 * look.patchiness * soft), np.float32)
