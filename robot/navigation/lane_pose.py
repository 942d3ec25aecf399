"""Where a robot stands relative to the lane it drives in."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple, Optional, Sequence

import numpy as np

from robot.geometry import bezier_points, bezier_tangents, wrap_angle
from robot.navigation.lanes import Lane, tile_lanes

if TYPE_CHECKING:
    from robot.navigation.road_map import RoadMap

_CHORDS = 48  # per lane, to find the parameter of the nearest point
_REFERENCE_BISECTIONS = 8  # gym-duckietown 6.1.34


class LanePose(NamedTuple):
    """A pose relative to the nearest point of a lane."""

    distance_m: float  # from the centre line, positive to the left
    dot_dir: float  # cosine of the angle between heading and lane
    angle_rad: float  # heading minus the lane's direction, positive to the left
    lane: Lane
    t: float  # parameter of the nearest point on the lane's Bezier


class LanesNear(NamedTuple):
    """The nearest point of each of L lanes to one position."""

    distance_m: np.ndarray  # (L,) to that point, not signed
    t: np.ndarray  # (L,) its Bezier parameter
    offset_m: np.ndarray  # (L,) of the position to the left of the lane
    heading_rad: np.ndarray  # (L,) of the lane there


class LaneIndex:
    """Finds the nearest point of every one of L lanes at once, exact to less than 0.1 mm."""

    def __init__(self, lanes: Sequence[Lane]) -> None:
        self.lanes = tuple(lanes)
        self._control = np.array([lane.control_points_m for lane in lanes]).reshape(-1, 4, 2)
        t = np.linspace(0.0, 1.0, _CHORDS + 1)
        points = np.array([bezier_points(control, t) for control in self._control])
        self._starts = points.reshape(-1, _CHORDS + 1, 2)[:, :-1]
        self._chords = np.diff(points.reshape(-1, _CHORDS + 1, 2), axis=1)
        self._inverse_squares = 1.0 / (self._chords**2).sum(axis=-1)

    def near(self, x_m: float, y_m: float) -> LanesNear:
        """The nearest point of every lane to a position."""
        position = np.array([x_m, y_m])
        delta = position - self._starts
        along = np.clip((delta * self._chords).sum(-1) * self._inverse_squares, 0.0, 1.0)
        squares = ((delta - along[..., None] * self._chords) ** 2).sum(-1)
        chord = squares.argmin(axis=1)
        rows = np.arange(len(self.lanes))
        t = (chord + along[rows, chord]) / _CHORDS
        point, tangent = _evaluate(self._control, t)
        delta = position - point
        direction = tangent / np.linalg.norm(tangent, axis=-1, keepdims=True)
        return LanesNear(
            np.hypot(delta[:, 0], delta[:, 1]),
            t,
            direction[:, 0] * delta[:, 1] - direction[:, 1] * delta[:, 0],
            np.arctan2(direction[:, 1], direction[:, 0]),
        )


def lane_pose(
    road_map: RoadMap, x_m: float, y_m: float, heading_rad: float, compat: bool = False
) -> Optional[LanePose]:
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


def _evaluate(control: np.ndarray, t: np.ndarray) -> np.ndarray:
    """Points and tangents (2, L, 2) of the Beziers (L, 4, 2), each at its own parameter (L,)."""
    u = 1.0 - t
    weights = np.stack((u**3, 3 * u**2 * t, 3 * u * t**2, t**3))
    slopes = np.stack((3 * u**2, 6 * u * t, 3 * t**2))
    point = np.einsum("kl,lkd->ld", weights, control)
    tangent = np.einsum("kl,lkd->ld", slopes, np.diff(control, axis=1))
    return np.stack((point, tangent))


def _reference_lane_pose(
    road_map: RoadMap, x_m: float, y_m: float, heading_rad: float
) -> Optional[LanePose]:
    tile = road_map.tile_at(x_m, y_m)
    if tile is None or not tile.is_road:
        return None
    lanes = tile_lanes(tile, road_map.tile_size_m, road_map.rows, reference=True)
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
