"""How the demonstration robot drives: where it starts, and a driver that follows a path."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from robot.contract import ACTION_TWISTS, Action
from robot.errors import ContractError
from robot.geometry import Pose
from robot.link.telemetry import MissionStatus, thin_path
from robot.navigation.path import Path
from robot.navigation.road_map import RoadMap

LOOK_AHEAD_M = 0.16
ARRIVED_M = 0.03
CURVATURES = tuple(twist.turn_radps / twist.forward_mps for twist in ACTION_TWISTS)


def start_pose(road_map: RoadMap) -> Pose:
    """A third into the map's first straight lane."""
    straight = [lane for lane in road_map.lanes if _is_straight(lane.control_points_m)]
    if not straight:
        raise ContractError(f"{road_map.name}: expected a map with a straight road, got none")
    first, _, _, last = straight[0].control_points_m
    x_m, y_m = first + (last - first) / 3.0
    return Pose(float(x_m), float(y_m), math.atan2(last[1] - first[1], last[0] - first[0]))


def _is_straight(points_m: np.ndarray) -> bool:
    chord = points_m[3] - points_m[0]
    inner = points_m[1:3] - points_m[0]
    offsets = chord[0] * inner[:, 1] - chord[1] * inner[:, 0]
    return bool(np.abs(offsets).max() < 1e-9)


class Drive:
    """One mission of the demo robot, and a driver that looks at a point ahead on its path."""

    def __init__(
        self,
        mission_id: str = "",
        path: Path | None = None,
        destination: tuple[float, float] = (0.0, 0.0),
    ) -> None:
        self.action: int | None = None
        self.values: tuple[float, ...] = ()
        self.target_m: np.ndarray | None = None
        self.status: MissionStatus | None = None
        self.points = thin_path(path.points_m) if path else ()
        self._path = path
        self._hint: int | None = None
        if path is not None:
            self.status = MissionStatus(mission_id, destination, remaining_m=path.length_m)

    def follow(self, pose: Pose) -> bool:
        """Choose an action; True when the end of the path is reached."""
        path = self._path
        assert path is not None
        assert self.status is not None
        place = path.project(pose.x_m, pose.y_m, self._hint)
        self._hint = place.index
        left_m = max(0.0, path.length_m - place.arc_m)
        self.status = replace(
            self.status,
            progress=min(1.0, place.arc_m / path.length_m),
            remaining_m=left_m,
            offset_m=place.offset_m,
        )
        self.target_m = path.point_at(np.array(place.arc_m + LOOK_AHEAD_M))
        # Pure pursuit: the arc through the robot and the point (Coulter 1992).
        forward_m, side_m = pose.to_robot(self.target_m)
        wanted = 2.0 * side_m / max(forward_m**2 + side_m**2, 1e-6)
        self.values = tuple(-abs(curvature - wanted) for curvature in CURVATURES)
        self.action = Action(int(np.argmax(self.values)))
        return left_m < ARRIVED_M

    def ended(self, phase: str, reason: str) -> None:
        """The mission is over."""
        self.action, self.values, self.target_m = None, (), None
        if self.status is not None and self.status.phase == "driving":
            self.points = ()
            progress = 1.0 if phase == "arrived" else self.status.progress
            self.status = replace(self.status, phase=phase, progress=progress, reason=reason)
