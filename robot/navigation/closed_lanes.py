"""Where things of a map reach into a lane, so that no robot passes."""

from __future__ import annotations

import math
from typing import FrozenSet, List, NamedTuple, Set, Tuple

import numpy as np

from robot.geometry import Pose
from robot.navigation.map_objects import MapObject, objects_of
from robot.navigation.object_kinds import Part, kinds
from robot.navigation.road_map import RoadMap

HALF_ROBOT_M = 0.09  # what a robot needs to each side of the middle of its lane
_SPACING_M = 0.05


class Blocked(NamedTuple):
    """What is in the way on a map."""

    points_m: np.ndarray  # (K, 2) of things, in the lanes
    lanes: FrozenSet[int]  # indices into the map's lanes


def blocked(road_map: RoadMap) -> Blocked:
    """What its objects that stand there in every episode leave no room beside."""
    points: List[Tuple[float, float]] = []
    lanes: Set[int] = set()
    things = [o for o in objects_of(road_map) if o.static and not o.optional]
    for thing in things if road_map.lanes else []:
        outline = footprint(thing)
        far_m = np.hypot(*(outline - (thing.x_m, thing.y_m)).T).max(initial=0.0) + HALF_ROBOT_M
        if road_map.lane_index.near(thing.x_m, thing.y_m).distance_m.min() > far_m:
            continue
        for x_m, y_m in outline.tolist():
            near = road_map.lane_index.near(x_m, y_m).distance_m < HALF_ROBOT_M
            if near.any():
                points.append((x_m, y_m))
                lanes.update(np.flatnonzero(near).tolist())
    return Blocked(np.array(points).reshape(-1, 2), frozenset(lanes))


def footprint(thing: MapObject) -> np.ndarray:
    """(K, 2) points in the world, every 5 cm of what a robot can run into."""
    place = Pose(thing.x_m, thing.y_m, thing.heading_rad)
    hard = [_points(part, thing.height_m) for part in kinds()[thing.kind].parts if part.collides]
    return place.to_world(np.concatenate([np.zeros((0, 2)), *hard]))


def _points(part: Part, height_m: float) -> np.ndarray:
    length, width = part.size[0], part.size[0 if part.shape == "cylinder" else 1]
    steps = [max(2, math.ceil(side * height_m / _SPACING_M) + 1) for side in (length, width)]
    x, y = np.meshgrid(
        np.linspace(-length / 2, length / 2, steps[0]), np.linspace(-width / 2, width / 2, steps[1])
    )
    if part.shape == "cylinder":
        inside = np.maximum(np.hypot(x, y) / (length / 2), 1.0)
        x, y = x / inside, y / inside
    return height_m * np.stack((x + part.forward, y + part.left), axis=-1).reshape(-1, 2)
