"""A road map as what a page draws: lanes, lines between them, floor and objects."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from robot.navigation.lanes import Lane
from robot.navigation.road_map import RoadMap
from sim_pybullet.scenery.map_objects import objects_of

Curve = tuple[float, ...]  # x0, y0, ... x3, y3 of a cubic Bezier, world frame [m]


@dataclass(frozen=True)
class FloorTile:
    """A tile without road; x, y of its south-west corner [m]."""

    kind: str
    x_m: float
    y_m: float


@dataclass(frozen=True)
class DrawnObject:
    """Something beside the road."""

    kind: str
    x_m: float
    y_m: float
    heading_rad: float
    height_m: float


@dataclass(frozen=True)
class MapDrawing:
    """All of it, in metres of the world frame."""

    name: str
    width_m: float
    height_m: float
    tile_size_m: float
    floor: tuple[FloorTile, ...]
    lanes: tuple[Curve, ...]
    centre_lines: tuple[Curve, ...]  # between the two lanes of a tile, where nobody turns
    objects: tuple[DrawnObject, ...]


def draw_map(road_map: RoadMap) -> MapDrawing:
    """The drawing of a road map."""
    size = road_map.tile_size_m
    floor = tuple(
        FloorTile(tile.kind, tile.column * size, (road_map.rows - 1 - tile.row) * size)
        for row in road_map.tiles
        for tile in row
        if not tile.is_road
    )
    objects = tuple(
        DrawnObject(o.kind, o.x_m, o.y_m, o.heading_rad, o.height_m) for o in objects_of(road_map)
    )
    return MapDrawing(
        road_map.name,
        road_map.width_m,
        road_map.height_m,
        size,
        floor,
        tuple(_curve(lane.control_points_m) for lane in road_map.lanes),
        _centre_lines(road_map.lanes),
        objects,
    )


def _centre_lines(lanes: tuple[Lane, ...]) -> tuple[Curve, ...]:
    by_tile: dict[tuple[int, int], list[np.ndarray]] = {}
    for lane in lanes:
        by_tile.setdefault((lane.tile_row, lane.tile_column), []).append(lane.control_points_m)
    pairs = (curves for curves in by_tile.values() if len(curves) == 2)
    return tuple(_curve((one + other[::-1]) / 2.0) for one, other in pairs)


def _curve(control_points_m: np.ndarray) -> Curve:
    return tuple(round(float(v), 4) for v in control_points_m.ravel())
