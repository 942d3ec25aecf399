"""Another painter of floors, for worlds that a policy is judged in and never trained in.

It shares no paint code and no noise with `sim_pybullet.painting.ground`: lines are tape laid strip
by strip along curves offset from the lanes, with torn ends and crooked edges; the surface is noise
shaped in the frequency domain, with rubber studs, specks and scratches.
"""

import math
from dataclasses import dataclass

import cv2
import numpy as np

from robot.geometry import bezier_points, bezier_tangents
from robot.navigation.road_map import Lane, RoadMap, Tile, tile_lanes
from sim_pybullet.look import GroundLook
from sim_pybullet.painting.shadows import cast_shadows
from sim_pybullet.scene import Ground, SemanticClass

TEXEL_M = 0.003
_SUBPIXEL_BITS = 4
_WHITE_OFFSET = 0.232  # of an edge line's middle from its lane's, in tiles
_YELLOW_OFFSET = 0.2
_WHITE_WIDTH_M, _YELLOW_WIDTH_M, _RED_WIDTH_M = 0.048, 0.024, 0.048  # rolls of tape
_DASH_M, _GAP_M = 0.05, 0.026
_SLOPE = 1.7  # of the surface's spectrum: photographs of floors fall off about so
_STUD_M = 0.019  # pitch of the studs of an anti-fatigue mat


@dataclass
class _Canvas:
    rgb: np.ndarray  # (H, W, 3) float32
    classes: np.ndarray  # (H, W) uint8
    texel_m: float
    north_m: float
    rng: np.random.Generator
    look: GroundLook

    def tape(self, middle_m: np.ndarray, width_m: float, colour: tuple, kind: int) -> None:
        """Lay tape along points (K, 2) in the world [m]."""
        width_m *= self.look.line_width_scale
        step = np.gradient(middle_m, axis=0)
        normal = np.stack((-step[:, 1], step[:, 0]), 1)
        normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-9)
        crooked = self.rng.normal(0.0, 0.0012, (2, len(middle_m), 1))
        left, right = normal * (0.5 * width_m + crooked[0]), normal * (0.5 * width_m + crooked[1])
        corners = np.concatenate((middle_m + left, (middle_m - right)[::-1]))
        pixels = np.stack((corners[:, 0], self.north_m - corners[:, 1]), 1) / self.texel_m - 0.5
        (west, top), (east, bottom) = np.floor(pixels.min(0)) - 1, np.ceil(pixels.max(0)) + 2
        top, bottom = max(0, int(top)), min(self.classes.shape[0], int(bottom))
        west, east = max(0, int(west)), min(self.classes.shape[1], int(east))
        if top >= bottom or west >= east:
            return
        fixed = np.round((pixels - (west, top)) * 2**_SUBPIXEL_BITS).astype(np.int32)
        cover = np.zeros((bottom - top, east - west), np.uint8)
        cv2.fillPoly(cover, [fixed], 255, cv2.LINE_AA, _SUBPIXEL_BITS)
        part = cover[..., None].astype(np.float32) / 255.0
        shade = 1.0 + self.rng.normal(0.0, 0.04)  # no two strips are equally clean
        seen = self.rgb[top:bottom, west:east]
        seen += part * (np.array(colour, np.float32) * shade - seen)
        self.classes[top:bottom, west:east][part[..., 0] >= 0.5] = kind

    def white(self, middle_m: np.ndarray) -> None:
        """Lay a white line along points (K, 2) [m]."""
        self.tape(middle_m, _WHITE_WIDTH_M, self.look.white_rgb, SemanticClass.WHITE_LINE)


def paint_strips(road_map: RoadMap, look: GroundLook) -> Ground:
    """The floor of ``road_map``; the same arguments paint the same floor."""
    rng = np.random.default_rng((look.texture_seed, 77))
    size = max(8, round(road_map.tile_size_m / TEXEL_M))
    texel_m = road_map.tile_size_m / size
    shape = (road_map.rows * size, road_map.columns * size)
    mats = [[tile.is_road or tile.kind == "asphalt" for tile in row] for row in road_map.tiles]
    on_mat = np.kron(mats, np.ones((size, size), bool))
    base = np.where(on_mat[..., None], np.array(look.asphalt_rgb), np.array(look.outside_rgb))
    classes = np.where(on_mat, SemanticClass.ROAD, SemanticClass.OUTSIDE).astype(np.uint8)
    north_m = road_map.rows * road_map.tile_size_m
    canvas = _Canvas(base.astype(np.float32), classes, texel_m, north_m, rng, look)
    _scatter(canvas, on_mat)
    _lay_lines(canvas, road_map)
    _scratch(canvas)
    canvas.rgb += _surface(shape, rng)[..., None] * np.float32(0.7 * look.grain)
    light = look.brightness * (1.0 + 0.3 * look.patchiness * _surface(shape, rng, slope=3.2))
    light *= cast_shadows(shape, texel_m, look.shadows, rng)
    rgb = np.clip(canvas.rgb * light[..., None] + 0.5, 0.0, 255.0).astype(np.uint8)
    return Ground(rgb, canvas.classes, texel_m, 0.0, north_m, look.beyond_rgb)


def _lay_lines(canvas: _Canvas, road_map: RoadMap) -> None:
    tile_m = road_map.tile_size_m
    for tile in road_map.road_tiles:
        if tile.is_junction:
            _lay_junction(canvas, road_map, tile)
            continue
        lanes = tile_lanes(tile, tile_m, road_map.rows)
        for lane in lanes:
            canvas.white(_offset(lane, -_WHITE_OFFSET * tile_m))
        _lay_dashes(canvas, _offset(lanes[0], _YELLOW_OFFSET * tile_m))


def _lay_dashes(canvas: _Canvas, middle_m: np.ndarray) -> None:
    along = np.concatenate(([0.0], np.cumsum(np.linalg.norm(np.diff(middle_m, axis=0), axis=1))))
    count = max(1, round(along[-1] / (_DASH_M + _GAP_M)))
    pitch = along[-1] / count
    for k in range(count):
        length = _DASH_M * canvas.rng.uniform(0.85, 1.1) * pitch / (_DASH_M + _GAP_M)
        begin = pitch * (k + 0.5) - 0.5 * length + canvas.rng.normal(0.0, 0.002)
        at = np.linspace(begin, begin + length, 6)
        points = np.stack([np.interp(at, along, middle_m[:, i]) for i in range(2)], 1)
        canvas.tape(points, _YELLOW_WIDTH_M, canvas.look.yellow_rgb, SemanticClass.YELLOW_LINE)


def _lay_junction(canvas: _Canvas, road_map: RoadMap, tile: Tile) -> None:
    """Quarter arcs at the corners between open sides, stop lines, an edge along a closed side."""
    tile_m = road_map.tile_size_m
    centre = np.array((tile.column + 0.5, road_map.rows - tile.row - 0.5)) * tile_m
    directions = np.array(((0, 1), (-1, 0), (0, -1), (1, 0)))  # north, west, south, east
    is_open = [side in tile.road_sides for side in "NWSE"]
    for k, direction in enumerate(directions):
        left = np.array((-direction[1], direction[0]))  # seen on the way out
        if not is_open[k]:
            ends = centre + tile_m * (0.432 * direction + 0.5 * np.outer((-1, 1), left))
            canvas.white(np.linspace(ends[0], ends[1], 12))
            continue
        ends = centre + tile_m * (0.46 * direction + np.outer((0.03, 0.4), left))
        stop = np.linspace(ends[0], ends[1], 12)
        canvas.tape(stop, _RED_WIDTH_M, canvas.look.red_rgb, SemanticClass.RED_LINE)
        if is_open[(k + 1) % 4]:
            corner = centre + 0.5 * tile_m * (direction + left)
            angles = np.linspace(0.0, 0.5 * math.pi, 12)
            arc = np.outer(np.cos(angles), -direction) + np.outer(np.sin(angles), -left)
            canvas.white(corner + 0.068 * tile_m * arc)


def _scatter(canvas: _Canvas, on_mat: np.ndarray) -> None:
    """Studs and specks on the mats, strong where ``grain`` is."""
    height, width = canvas.classes.shape
    pitch = _STUD_M / canvas.texel_m
    v, u = np.mgrid[0:height, 0:width].astype(np.float32)
    studs = np.cos(2 * np.pi * (u + v) / pitch) * np.cos(2 * np.pi * (u - v) / pitch)
    specks = np.zeros((height, width), np.float32)
    count = height * width // 900
    at = canvas.rng.integers(0, (height, width), (count, 2))
    specks[at[:, 0], at[:, 1]] = canvas.rng.normal(0.0, 12.0, count)
    rough = 0.6 * np.clip(studs, 0.0, 1.0) + cv2.GaussianBlur(specks, (0, 0), 0.8)
    canvas.rgb += (on_mat * rough * canvas.look.grain * 0.8)[..., None].astype(np.float32)


def _scratch(canvas: _Canvas) -> None:
    """Worn away places, long and thin, through paint and floor alike."""
    height, width = canvas.classes.shape
    marks = np.zeros((height, width), np.uint8)
    for _ in range(round(canvas.look.wear * height * width / 4000)):
        x, y = canvas.rng.uniform(0, width), canvas.rng.uniform(0, height)
        angle, length = canvas.rng.uniform(0, math.pi), canvas.rng.exponential(25.0)
        end = (round(x + length * math.cos(angle)), round(y + length * math.sin(angle)))
        cv2.line(marks, (round(x), round(y)), end, 255, int(canvas.rng.integers(1, 4)), cv2.LINE_AA)
    share = marks[..., None].astype(np.float32) / 255.0 * 0.7
    canvas.rgb += share * (1.3 * np.array(canvas.look.asphalt_rgb, np.float32) - canvas.rgb)


def _surface(shape: tuple[int, int], rng: np.random.Generator, slope: float = _SLOPE) -> np.ndarray:
    """Unit deviation; the amplitude falls with the frequency to the power ``slope`` / 2."""
    rows, columns = np.fft.fftfreq(shape[0])[:, None], np.fft.rfftfreq(shape[1])[None]
    frequency = np.hypot(rows, columns)
    frequency[0, 0] = 1.0
    spectrum = np.fft.rfft2(rng.standard_normal(shape)) / frequency ** (0.5 * slope)
    spectrum[0, 0] = 0.0
    field = np.fft.irfft2(spectrum, shape)
    return np.asarray(field / field.std(), np.float32)


def _offset(lane: Lane, left_m: float, points: int = 24) -> np.ndarray:
    """Points (K, 2) beside a lane's middle, to its left where positive [m]."""
    t = np.linspace(0.0, 1.0, points)
    tangents = bezier_tangents(lane.control_points_m, t)
    tangents = tangents / np.linalg.norm(tangents, axis=1, keepdims=True)
    normals = np.stack((-tangents[:, 1], tangents[:, 0]), 1)
    return bezier_points(lane.control_points_m, t) + left_m * normals
