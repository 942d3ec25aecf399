"""Where the lines of a road map lie, as a picture of its floor from above.

Bands as on Duckietown's mats: yellow 0.2 tiles to the left of a lane's middle, white 0.232 to its
right; a junction has white corners, a white edge along its closed side and no yellow.
"""

import math
from dataclasses import dataclass
from typing import Tuple

import numpy as np

from robot.geometry import bezier_points, wrap_angle
from robot.navigation.road_map import ORIENTATIONS, Lane, RoadMap, Tile

TEXEL_M = 0.01
MARGIN_M = 0.5  # around the grid
YELLOW_TILES, WHITE_TILES = 0.2, -0.232  # beside the middle of a lane, positive to its left
YELLOW_M, WHITE_M = 0.025, 0.05  # width of the paint
_STOPS = {  # where red lines may lie at a junction's sides: west, south, east, north, in tiles
    "S": (0.0, -0.1, 1.0, 0.1),
    "N": (0.0, 0.9, 1.0, 1.1),
    "W": (-0.1, 0.0, 0.1, 1.0),
    "E": (0.9, 0.0, 1.1, 1.0),
}
TILE_M = 0.585  # of Duckietown's mats
FAR_WHITE_TILES = 0.632  # the far edge of the road, beside the middle of the right lane
DASHED = 0.64  # share of the yellow line that is painted
SOFT_M = 0.015  # standard deviation by which edges are softened: poses and paint are never exact
_SHIFT = 4  # fractional bits of cv2's coordinates


@dataclass(frozen=True)
class RoadPaint:
    """``cover`` (H, W, 3) float32, rows from the south: white, yellow, known (road without red)."""

    cover: np.ndarray

    def at(self, x_m: np.ndarray, y_m: np.ndarray) -> np.ndarray:
        """(..., 3) under points of the world [m]; unknown beyond the grid."""
        height, width, planes = self.cover.shape
        columns = ((x_m + MARGIN_M) * (1.0 / TEXEL_M)).astype(np.int32)
        rows = ((y_m + MARGIN_M) * (1.0 / TEXEL_M)).astype(np.int32)
        np.clip(columns, 0, width - 1, out=columns)  # the margin is unknown
        np.clip(rows, 0, height - 1, out=rows)
        rows *= width
        rows += columns
        return np.asarray(self.cover.reshape(-1, planes)[rows])


def road_paint(road_map: RoadMap) -> RoadPaint:
    """The lines of a whole map."""
    import cv2

    extent_m = np.array((road_map.height_m, road_map.width_m)) + 2.0 * MARGIN_M
    shape = np.ceil(extent_m / TEXEL_M).astype(int)
    white, yellow, known = (np.zeros(shape, np.uint8) for _ in range(3))
    for tile in road_map.road_tiles:
        _fill(known, (0.0, 0.0, 1.0, 1.0), tile, road_map, 255)
    for lane in road_map.lanes:
        if not lane.tile.is_junction:
            _draw(yellow, lane, YELLOW_TILES * road_map.tile_size_m, YELLOW_M)
        if not lane.tile.is_junction or _has_edge(lane):
            _draw(white, lane, WHITE_TILES * road_map.tile_size_m, WHITE_M)
    for tile in road_map.road_tiles:
        for side in tile.road_sides if tile.is_junction else ():
            _fill(known, _STOPS[side], tile, road_map, 0)
    lines = [cv2.GaussianBlur(plane, (0, 0), SOFT_M / TEXEL_M) for plane in (white, yellow)]
    return RoadPaint(np.stack((*lines, known), axis=-1).astype(np.float32) / np.float32(255.0))


def _draw(plane: np.ndarray, lane: Lane, left_m: float, width_m: float) -> None:
    """A line that runs so far to the left of a lane."""
    import cv2

    points = bezier_points(lane.control_points_m, np.linspace(0.0, 1.0, 24))
    along = np.gradient(points, axis=0)
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    points_m = points + left_m * np.stack((-along[:, 1], along[:, 0]), axis=1)
    fixed = np.rint(((points_m + MARGIN_M) / TEXEL_M - 0.5) * 2**_SHIFT).astype(np.int32)[:, None]
    cv2.polylines(plane, [fixed], False, 255, max(1, round(width_m / TEXEL_M)), cv2.LINE_AA, _SHIFT)


def _has_edge(lane: Lane) -> bool:
    """Whether a lane through a junction has a line on its right: a corner, or the closed side."""
    begin, end = np.diff(lane.control_points_m, axis=0)[[0, 2]]
    heading_rad = math.atan2(begin[1], begin[0])
    turn_rad = float(wrap_angle(math.atan2(end[1], end[0]) - heading_rad))
    if abs(turn_rad) > 0.25 * math.pi:
        return turn_rad < 0.0
    # The side to the right of a lane that runs east is the south one.
    return ORIENTATIONS[round(heading_rad / (0.5 * math.pi)) % 4] not in lane.tile.road_sides


def _fill(plane: np.ndarray, box: Tuple[float, ...], tile: Tile, road: RoadMap, value: int) -> None:
    """Fill what lies within west, south, east and north, in tiles from a tile's corner."""
    corner = (tile.column, road.rows - 1 - tile.row)
    box_m = (np.array(box).reshape(2, 2) + corner) * road.tile_size_m
    (west, south), (east, north) = np.rint((box_m + MARGIN_M) / TEXEL_M).astype(int)
    plane[south:north, west:east] = value


def bent_lane(points_m: np.ndarray, bend_pm: float) -> np.ndarray:
    """White, yellow and known (A, N, 3) beside a lane with its middle below the robot.

    Points (A, N, 2) are in the frame of the lane's beginning; it bends left by ``bend_pm`` [1/m].
    """
    ahead, left = points_m[..., 0], points_m[..., 1]
    if bend_pm:
        radius_m = 1.0 / bend_pm
        left = radius_m - math.copysign(1.0, bend_pm) * np.hypot(ahead, left - radius_m)

    def line(tiles: float, width_m: float) -> np.ndarray:
        beyond_m = np.abs(left - tiles * TILE_M) - 0.5 * width_m
        return np.asarray(np.clip(0.5 - 0.5 * beyond_m / SOFT_M, 0.0, 1.0))

    white = line(WHITE_TILES, WHITE_M) + line(FAR_WHITE_TILES, WHITE_M)
    known = (left > WHITE_TILES * TILE_M - 0.12) & (left < FAR_WHITE_TILES * TILE_M + 0.08)
    yellow = DASHED * line(YELLOW_TILES, YELLOW_M)
    return np.stack((white, yellow, known), axis=-1).astype(np.float32)
