"""A road map as what a page draws: lanes, lines between them, floor and objects."""

from typing import Any

import numpy as np

from robot.navigation.map_objects import objects_of
from robot.navigation.road_map import Lane, RoadMap


def draw_map(road_map: RoadMap) -> dict[str, Any]:
    """The drawing of a road map, for JSON, in metres of the world frame.

    ``lanes`` and ``centre_lines`` (between the two lanes of a tile, where nobody turns) are cubic
    Beziers x0, y0, ... x3, y3; ``floor`` are tiles without road, by their south-west corners.
    """
    size = road_map.tile_size_m
    return {
        "name": road_map.name,
        "width_m": road_map.width_m,
        "height_m": road_map.height_m,
        "tile_size_m": size,
        "floor": [
            {
                "kind": tile.kind,
                "x_m": tile.column * size,
                "y_m": (road_map.rows - 1 - tile.row) * size,
            }
            for row in road_map.tiles
            for tile in row
            if not tile.is_road
        ],
        "lanes": [_curve(lane.control_points_m) for lane in road_map.lanes],
        "centre_lines": _centre_lines(road_map.lanes),
        "objects": [
            {name: getattr(o, name) for name in ("kind", "x_m", "y_m", "heading_rad", "height_m")}
            for o in objects_of(road_map)
        ],
    }


def _centre_lines(lanes: tuple[Lane, ...]) -> list[list[float]]:
    by_tile: dict[tuple[int, int], list[np.ndarray]] = {}
    for lane in lanes:
        by_tile.setdefault((lane.tile_row, lane.tile_column), []).append(lane.control_points_m)
    pairs = (curves for curves in by_tile.values() if len(curves) == 2)
    return [_curve((one + other[::-1]) / 2.0) for one, other in pairs]


def _curve(control_points_m: np.ndarray) -> list[float]:
    return [round(float(v), 4) for v in control_points_m.ravel()]
