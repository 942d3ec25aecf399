"""Figures of the reference simulator, and its maps and frame."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path
from typing import Any, List

import numpy as np

from robot.geometry import Pose
from robot.navigation.map_objects import MapObject
from robot.navigation.road_map import RoadMap, Tile, load_map, tile_lanes


def oracle_maps(data_dir: Path) -> dict[str, Any]:
    """What the simulator says of each map, by name."""
    return json.loads((data_dir / "oracle" / "map_geometry.json").read_text())["maps"]


def sim_to_world(points: Any, road_map: RoadMap) -> np.ndarray:
    """The simulator's (..., 3) x, up, z (south) as our (..., 2) x, y."""
    array = np.array(points)
    return np.stack((array[..., 0], road_map.height_m - array[..., 2]), axis=-1)


def oracle_map(data_dir: Path, name: str) -> RoadMap:
    """The map that the simulator was asked about."""
    return load_map(data_dir / "maps" / "duckietown" / f"{name}.yaml")


# Of orientation S, as the simulator bulges it; the other one meets the next tile straight.
_CURVE_RIGHT = ((-0.5, -0.2), (-0.3, -0.2), (0.3, 0.0), (0.2, 0.5))


def reference_lanes(tile: Tile, road_map: RoadMap) -> List[np.ndarray]:
    """The curves (4, 2) that the simulator draws through a tile: two of its kinds are wrong."""
    if tile.kind == "3way_right":  # taken for the left one
        tile = replace(tile, kind="3way_left")
    lanes = tile_lanes(tile, road_map.tile_size_m, road_map.rows)
    curves = [lane.control_points_m for lane in lanes]
    if tile.kind == "curve_right":
        quarter = np.array(((0, 1), (-1, 0)))
        turned = np.array(_CURVE_RIGHT) @ np.linalg.matrix_power(quarter, tile.quarter_turns)
        centre = (tile.column + 0.5, road_map.rows - tile.row - 0.5)
        curves[1] = (turned + centre) * road_map.tile_size_m
    return curves


def reference_place(thing: MapObject, road_map: RoadMap) -> Pose:
    """Where the simulator puts an object: it mixes up rows and columns, and turns it the other way;
    it counts a slot's offset in tiles, and leaves a slot out where there is a pose.
    """
    objects = road_map.objects
    entry = objects[thing.name] if isinstance(objects, dict) else objects[int(thing.name[7:])]
    size_m = road_map.tile_size_m
    if "pos" in entry:
        shift_m = (road_map.columns - 1 - road_map.rows) * size_m
        return Pose(thing.x_m, thing.y_m + shift_m, -thing.heading_rad)
    if "attach" not in entry:
        return Pose(thing.x_m, thing.y_m, thing.heading_rad)
    corner_m = np.array(entry["attach"]["tile"]) * size_m
    along_m = np.array((thing.x_m, thing.y_m)) - corner_m
    if "pose" in entry:
        content = entry["pose"]["~SE2Transform"]
        return Pose(*content.get("p", (0.0, 0.0)), math.radians(content.get("theta_deg", 0.0)))
    return Pose(*(corner_m + size_m * along_m), thing.heading_rad)
