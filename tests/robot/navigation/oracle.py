"""Figures of the reference simulator, and its maps and frame."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from robot.navigation.road_map import RoadMap, load_map


def oracle_maps(data_dir: Path) -> dict[str, Any]:
    """What the simulator says of each map, by name."""
    return json.loads((data_dir / "oracle" / "map_geometry.json").read_text())["maps"]


def sim_to_world(points: Any, road_map: RoadMap) -> np.ndarray:
    """The simulator's (..., 3) x, up, z (south) as our (..., 2) x, y."""
    array = np.array(points)
    return np.stack((array[..., 0], road_map.height_m - array[..., 2]), axis=-1)


def oracle_map(data_dir: Path, name: str) -> RoadMap:
    """The map as the simulator reads it."""
    return load_map(data_dir / "maps" / "duckietown" / f"{name}.yaml", compat=True)
