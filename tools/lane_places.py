"""Where robots begin: poses on lanes, along them."""

from __future__ import annotations

import math

import numpy as np

from robot.errors import ContractError
from robot.geometry import Pose, bezier_points, bezier_tangents
from robot.navigation.lanes import Lane
from robot.navigation.road_map import RoadMap


def on_lane(lane: Lane, t: float) -> Pose:
    """The pose at a parameter of the lane's Bezier, 0 to 1."""
    (at,) = bezier_points(lane.control_points_m, np.array([t]))
    (ahead,) = bezier_tangents(lane.control_points_m, np.array([t]))
    return Pose(float(at[0]), float(at[1]), math.atan2(ahead[1], ahead[0]))


def on_straight_lane(road_map: RoadMap, share: float) -> Pose:
    """The pose after a share of the longest straight lane; ContractError on a map without one."""
    longest, found = 0.0, None
    for lane in road_map.lanes:
        points = np.asarray(lane.control_points_m)
        (x_m, y_m), ways = points[3] - points[0], np.diff(points, axis=0)
        straight = np.abs(x_m * ways[:, 1] - y_m * ways[:, 0]).max() < 1e-9
        if straight and math.hypot(x_m, y_m) > longest:
            longest, at = math.hypot(x_m, y_m), points[0] + share * (points[3] - points[0])
            found = Pose(float(at[0]), float(at[1]), math.atan2(y_m, x_m))
    if found is None:
        raise ContractError(f"{road_map.name}: expected a map with a straight road, got none")
    return found
