"""A race track under a ``Look``: road, kerbs, grass and landscape painted, walls as boxes."""

import math
from functools import lru_cache

import numpy as np
from numba import njit, prange

from sim_pybullet.look import Look
from sim_pybullet.painting.ground import paint_left, soft_light, surface_noise
from sim_pybullet.racing.track import SCALE, SPACING_M, CentreLine, Track, centre_line
from sim_pybullet.scene import Ground, SemanticClass, Solid

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
    ground, marks, wide = look.ground, look.track, look.ground.line_width_scale
    grounds = (ground.asphalt_rgb, marks.grass_rgb, ground.outside_rgb)
    paints = (marks.kerb_rgb, marks.kerb_2_rgb, ground.white_rgb, ground.yellow_rgb)
    real_m = (LINE_M * wide, KERB_M, STONE_M, CENTRE_LINE_M * wide, marks.dashes_m)
    sizes_m = (line.half_width_m, line.verge_m, *(SCALE * size_m for size_m in real_m))
    spacing_m = line.path.length_m / len(line.curvature)
    noise = surface_noise(ground.texture_seed)
    height, width = (math.ceil(side * texel_m / _PATCH_M) + 1 for side in offset_m.shape)
    colours = np.array((*grounds, *paints), np.float32)
    sizes, grain = np.array((*sizes_m, spacing_m, texel_m)), noise.grain * np.float32(ground.grain)
    light = soft_light((height, width), offset_m.shape, ground)
    left = paint_left(noise, ground)
    rgb, classes = lay(offset_m, arc_m, bends, colours, sizes, grain, left, light)
    return Ground(rgb, classes, texel_m, 0.0, len(classes) * texel_m, ground.beyond_rgb)


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
    colours, thick_m = (look.track.wall_rgb, look.track.wall_2_rgb), THICK_M * SCALE
    walls = []
    for k in np.flatnonzero(kept).tolist():
        size_m = math.hypot(*along[k]), thick_m, look.track.wall_height_m * SCALE
        (x_m, y_m), turned = middles[k].tolist(), math.atan2(along[k, 1], along[k, 0])
        walls.append(Solid("box", x_m, y_m, turned, size_m, colours[k % 2], SemanticClass.WALL))
    return walls


BLOCK = 32  # texels on a side that search together
FAR = np.float32(1e9)  # offset of texels that are nowhere near the track
_OUTSIDE, _ROAD = int(SemanticClass.OUTSIDE), int(SemanticClass.ROAD)
_WHITE, _YELLOW = int(SemanticClass.WHITE_LINE), int(SemanticClass.YELLOW_LINE)
_KERB = int(SemanticClass.KERB)
# Rows of the colours
ROAD, GRASS, OUTSIDE, KERB, KERB_2, WHITE, YELLOW = range(7)


@njit(parallel=True, nogil=True, cache=True, fastmath=True)
def locate(
    points: np.ndarray, shape: tuple[int, int], north: float, texel: float, reach: float
) -> tuple[np.ndarray, np.ndarray]:
    """Offset from the centre line and arc length of each texel, both (H, W) float32.

    ``points`` (M, 4) are x, y, heading and arc length of the centre line, evenly spaced. Row 0 is
    at y = ``north``, column 0 at x = 0. Beyond ``reach`` the offset is FAR.
    """
    height, width = shape
    offset, arc = np.full(shape, FAR, np.float32), np.zeros(shape, np.float32)
    rows, columns = (height + BLOCK - 1) // BLOCK, (width + BLOCK - 1) // BLOCK
    wide = reach + 0.75 * BLOCK * texel
    for block in prange(rows * columns):
        top, left = int(block) // columns * BLOCK, int(block) % columns * BLOCK
        x0, y0 = (left + 0.5 * BLOCK) * texel, north - (top + 0.5 * BLOCK) * texel
        near = np.flatnonzero((points[:, 0] - x0) ** 2 + (points[:, 1] - y0) ** 2 < wide * wide)
        if len(near) == 0:
            continue
        for v in range(top, min(top + BLOCK, height)):
            for u in range(left, min(left + BLOCK, width)):
                x, y = (u + 0.5) * texel, north - (v + 0.5) * texel
                best, found = reach * reach, -1
                for j in range(len(near)):
                    k = int(near[j])
                    square = (points[k, 0] - x) ** 2 + (points[k, 1] - y) ** 2
                    if square < best:
                        best, found = square, k
                if found >= 0:
                    dx, dy = x - points[found, 0], y - points[found, 1]
                    c, s = math.cos(points[found, 2]), math.sin(points[found, 2])
                    offset[v, u] = c * dy - s * dx
                    arc[v, u] = points[found, 3] + c * dx + s * dy
    return offset, arc


@njit(cache=True, fastmath=True, inline="always")
def _band(x: float, low: float, high: float, texel: float) -> float:
    """How much of a texel around x lies between two borders."""
    inside = min(x + 0.5 * texel, high) - max(x - 0.5 * texel, low)
    return min(max(inside / texel, 0.0), 1.0)


@njit(parallel=True, nogil=True, cache=True, fastmath=True)
def lay(
    offset: np.ndarray,  # (H, W) as of ``locate``
    arc: np.ndarray,  # (H, W) likewise
    bends: np.ndarray,  # (M,) bool, whether there are kerbs at the centre line's points
    colours: np.ndarray,  # (7, 3) float32, rows as named above
    # half width, verge, edge line, kerb, length of a kerb stone, centre line, its dashes' period,
    # point spacing, texel
    sizes: np.ndarray,
    grain: np.ndarray,  # (S, S) float32, S a power of two: noise [grey levels]
    kept: np.ndarray,  # (S, S) float32: share of paint left
    brightness: np.ndarray,  # (H, W) float32 factor
) -> tuple[np.ndarray, np.ndarray]:
    """Colours (H, W, 3) uint8 and classes (H, W) uint8 of a track's ground."""
    half, verge, line, kerb, stone, middle, period, spacing, texel = sizes
    height, width = offset.shape
    rgb, classes = np.empty((height, width, 3), np.uint8), np.empty((height, width), np.uint8)
    mask = len(grain) - 1
    for v in prange(height):
        for u in range(width):
            away = abs(offset[v, u])
            light, noise = brightness[v, u], grain[v & mask, u & mask]
            paint = kept[v & mask, u & mask]
            base, kind, white, yellow = OUTSIDE, _OUTSIDE, 0.0, 0.0
            if away < half:
                base, kind = ROAD, _ROAD
                white = _band(away, half - 1.5 * line, half - 0.5 * line, texel)
                white = max(white, _band(arc[v, u], 0.0, 2.0 * line, texel))
                if arc[v, u] % period < 0.5 * period:
                    yellow = _band(away, -0.5 * middle, 0.5 * middle, texel)
            elif away < half + verge:
                base, noise = GRASS, 2.0 * noise
                index = min(max(int(arc[v, u] / spacing), 0), len(bends) - 1)
                if away < half + kerb and bends[index]:
                    base, kind = KERB + int(arc[v, u] / stone) % 2, _KERB
            if white * paint > 0.5:
                kind = _WHITE
            elif yellow * paint > 0.5:
                kind = _YELLOW
            classes[v, u] = kind
            white, yellow = white * paint, yellow * paint
            for c in range(3):
                value = colours[base, c] * (1.0 - white) + colours[WHITE, c] * white
                value = value * (1.0 - yellow) + colours[YELLOW, c] * yellow
                rgb[v, u, c] = np.uint8(min(max((value + noise) * light + 0.5, 0.0), 255.0))
    return rgb, classes
