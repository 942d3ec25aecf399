"""Where a robot stands relative to the lane it drives in."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from robot.geometry import bezier_points, bezier_tangents, wrap_angle
from robot.navigation.road_map import Lane, RoadMap
from tests.robot.navigation.oracle import reference_lanes

_REFERENCE_BISECTIONS = 8  # gym-duckietown 6.1.34


class LanePose(NamedTuple):
    """A pose relative to the nearest point of a lane."""

    distance_m: float  # from the centre line, positive to the left
    dot_dir: float  # cosine of the angle between heading and lane
    angle_rad: float  # heading minus the lane's direction, positive to the left
    lane: Lane
    t: float  # parameter of the nearest point on the lane's Bezier


def lane_pose(
    road_map: RoadMap, x_m: float, y_m: float, heading_rad: float, compat: bool = False
) -> LanePose | None:
    """The pose relative to a lane; None where the position is not on a road tile.

    The lane is the nearest one among those whose direction, at the point nearest to the robot, lies
    within 90 degrees of the heading.

    ``compat`` gives gym-duckietown 6.1.34's figures: of the lanes of the tile, the one whose chord
    has the largest dot product with the heading, however far away; its nearest point by eight
    bisections; distance and angle positive to the *right*.
    """
    if compat:
        return _reference_lane_pose(road_map, x_m, y_m, heading_rad)
    if not road_map.on_road(x_m, y_m):
        return None
    near = road_map.lane_index.near(x_m, y_m)
    angles = np.asarray(wrap_angle(heading_rad - near.heading_rad))
    along = np.flatnonzero(np.abs(angles) <= math.pi / 2)
    if not len(along):
        return None
    i = int(along[near.distance_m[along].argmin()])
    angle_rad = float(angles[i])
    return LanePose(
        float(near.offset_m[i]),
        math.cos(angle_rad),
        angle_rad,
        road_map.lanes[i],
        float(near.t[i]),
    )


def _reference_lane_pose(
    road_map: RoadMap, x_m: float, y_m: float, heading_rad: float
) -> LanePose | None:
    tile = road_map.tile_at(x_m, y_m)
    if tile is None or not tile.is_road:
        return None
    lanes = [Lane(tile, control_points_m=curve) for curve in reference_lanes(tile, road_map)]
    forward = np.array([math.cos(heading_rad), math.sin(heading_rad)])
    chords = np.array([lane.control_points_m[3] - lane.control_points_m[0] for lane in lanes])
    lane = lanes[int((chords @ forward).argmax())]
    position = np.array([x_m, y_m])
    t = _bisect_closest(lane.control_points_m, position)
    tangent = bezier_tangents(lane.control_points_m, np.array([t]))[0]
    tangent /= np.linalg.norm(tangent)
    right = np.array([tangent[1], -tangent[0]])
    offset = position - bezier_points(lane.control_points_m, np.array([t]))[0]
    dot_dir = float(np.clip(forward @ tangent, -1.0, 1.0))
    angle_rad = math.copysign(math.acos(dot_dir), forward @ right)
    return LanePose(float(offset @ right), dot_dir, angle_rad, lane, t)


def _bisect_closest(control: np.ndarray, position: np.ndarray) -> float:
    """Halve the parameter interval towards its nearer end, as the simulator does."""
    low, high = 0.0, 1.0
    for _ in range(_REFERENCE_BISECTIONS):
        ends = bezier_points(control, np.array([low, high])) - position
        middle = 0.5 * (low + high)
        if np.linalg.norm(ends[0]) < np.linalg.norm(ends[1]):
            high = middle
        else:
            low = middle
    return 0.5 * (low + high)
