"""A race track under a ``Look``: road, kerbs, grass and landscape painted, walls as boxes."""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np

from sim_pybullet.classes import SemanticClass
from sim_pybullet.look import GroundLook, Look
from sim_pybullet.painting.ground import outside_rgb, paint_left, soft_light, surface_noise
from sim_pybullet.racing.track import SCALE, SPACING_M, CentreLine, Track, centre_line
from sim_pybullet.racing.track_kernel import lay, locate
from sim_pybullet.scene import Ground, Solid

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
THICK_M = 0.6  # of the real track, as what follows
SAG_M = 0.15  # a wall piece is at most so far from the curve that it follows
SHORTEST_M, LONGEST_M = 3, 20  # pieces; centre lines have a point every metre
_CLEAR_M = 0.3  # walls nearer than this to the edge of another part of the track are left out
_PATCH_M = 0.3  # of the world: size of light and dark areas


def paint_track(track: Track, look: Look) -> Ground:
    """The ground of ``track``; the same arguments paint the same ground."""
    line, (offset_m, arc_m, texel_m) = centre_line(track), track_field(track)
    bend = np.abs(line.curvature) * SCALE > 1.0 / KERB_RADIUS_M
    around = range(-KERB_BEFORE_M, KERB_BEFORE_M + 1)
    bends = np.asarray(np.stack([np.roll(bend, k) for k in around]).any(axis=0))
    ground = look.ground
    noise = surface_noise(ground.texture_seed)
    rgb, classes = lay(
        offset_m,
        arc_m,
        bends,
        _colours(look),
        _sizes(line, look, texel_m),
        noise.grain * np.float32(ground.grain),
        paint_left(noise, ground),
        _brightness(offset_m.shape, texel_m, ground),
    )
    north_m = classes.shape[0] * texel_m
    return Ground(rgb, classes, texel_m, 0.0, north_m, outside_rgb(ground))


@lru_cache(maxsize=2)
def track_field(track: Track) -> tuple[np.ndarray, np.ndarray, float]:
    """As of `locate`, and a texel's size [m]; worked out once for all the looks of a track."""
    line = centre_line(track)
    east_m, north_m = line.size_m
    texel_m = max(FINEST_TEXEL_M, math.sqrt(east_m * north_m / MOST_TEXELS))
    shape = (math.ceil(north_m / texel_m), math.ceil(east_m / texel_m))
    path = line.path
    points = np.column_stack((path.points_m, path.headings_rad, path.arc_m))
    reach_m = line.half_width_m + line.verge_m + SPACING_M * SCALE
    offset_m, arc_m = locate(points, shape, shape[0] * texel_m, texel_m, reach_m)
    return offset_m, arc_m, texel_m


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
    cells = [math.ceil(side * texel_m / _PATCH_M) + 1 for side in shape[:2]]
    return soft_light((cells[0], cells[1]), shape, look)


def track_walls(track: Track, look: Look) -> tuple[Solid, ...]:
    """Both walls, in pieces of two colours by turns; none where the track runs by itself."""
    line = centre_line(track)
    ends = _pieces(line)
    return tuple(solid for side in (1.0, -1.0) for solid in _wall(line, ends, side, look))


def _pieces(line: CentreLine) -> np.ndarray:
    """Indices of the centre line's points at which pieces begin, and the first again."""
    bend = np.abs(line.curvature) * SCALE
    begins, count = [0], len(bend)
    while begins[-1] < count:
        ahead = bend[begins[-1] : begins[-1] + LONGEST_M].max()
        most = math.sqrt(8.0 * SAG_M / ahead) if ahead > 0.0 else LONGEST_M
        begins.append(begins[-1] + int(min(max(most, SHORTEST_M), LONGEST_M)))
    begins[-1] = count
    return np.array(begins) % count


def _wall(line: CentreLine, ends: np.ndarray, side: float, look: Look) -> list[Solid]:
    away_m = line.half_width_m + line.verge_m
    along_rad = line.path.headings_rad[ends]
    left = np.stack((-np.sin(along_rad), np.cos(along_rad)), axis=1)
    corners = line.path.points_m[ends] + side * (away_m + 0.5 * THICK_M * SCALE) * left
    middles, along = 0.5 * (corners[1:] + corners[:-1]), np.diff(corners, axis=0)
    points = line.path.points_m
    nearest = np.array([np.hypot(*(points - middle).T).min() for middle in middles])
    headings = along_rad[:-1]
    forward = along[:, 0] * np.cos(headings) + along[:, 1] * np.sin(headings)
    kept = (nearest > away_m - _CLEAR_M * SCALE) & (forward > 0.0)
    colours = (look.track.wall_rgb, look.track.wall_2_rgb)
    return [
        Solid(
            "box",
            float(middles[k, 0]),
            float(middles[k, 1]),
            math.atan2(along[k, 1], along[k, 0]),
            (math.hypot(*along[k]), THICK_M * SCALE, look.track.wall_height_m * SCALE),
            colours[k % 2],
            SemanticClass.WALL,
        )
        for k in np.flatnonzero(kept).tolist()
    ]
