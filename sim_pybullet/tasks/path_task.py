"""``PathTask``: what all tasks share in which each robot has a path to follow."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from robot.errors import ConfigError
from robot.geometry import Pose, wrap_angle
from robot.navigation.path import Path
from robot.navigation.path_batch import PathBatch
from sim_pybullet.tasks.base import Starts, TaskStep
from sim_pybullet.tasks.following import (
    MAX_HEADING_ERROR_RAD,
    START_HEADING_RAD,
    START_OFFSET,
    Course,
    PathFollower,
)
from sim_pybullet.vehicle import Vehicle

if TYPE_CHECKING:
    from sim_pybullet.scenery.place import Place


class PathTask(ABC):
    """Keeps `sim_pybullet.tasks.base.Task` but for the names, and for what a step is worth.

    An episode begins on a random map, a little off the path and askew.

    Args:
        road_maps: M maps or tracks.
        vehicle: of N robots.
        n_robots: N.
        half_widths_m: (M,) distance from the path at which a robot leaves its lane.
        path: any, until episodes begin.
        start_spread: multiplies how far from the path and how askew an episode may begin.
    """

    guided = False
    frames = 1

    def __init__(
        self,
        road_maps: Sequence[Place],
        vehicle: Vehicle,
        n_robots: int,
        half_widths_m: np.ndarray,
        path: Path,
        start_spread: float = 1.0,
    ) -> None:
        self.n_robots, self.vehicle = n_robots, vehicle
        self.road_maps = tuple(road_maps)
        self._half_widths_m, self._spread = half_widths_m, start_spread
        self._follower = PathFollower(path, n_robots)
        self._lengths_m = np.zeros(n_robots)  # of the robots' paths
        self._maps = np.zeros(n_robots, dtype=int)
        self._steps = np.zeros(n_robots, dtype=int)

    @property
    def paths(self) -> PathBatch:
        """The path that each robot should follow."""
        return self._follower.paths

    @property
    def course(self) -> Course:
        """Where each robot is on its path."""
        return self._follower.course

    @property
    def half_lane_m(self) -> np.ndarray:
        """(N,) distance from the path at which a robot leaves its lane."""
        return np.asarray(self._half_widths_m[self._maps])

    def reset(
        self, robots: np.ndarray, rng: np.random.Generator, number: int | None = None
    ) -> Starts:
        """Begin an episode for these robots (M,) on a random map, or on that of its number."""
        count = len(self.road_maps)
        maps = rng.integers(count, size=len(robots))
        turn = None
        if number is not None:
            maps[:], turn = number % count, number // count
        poses = np.zeros((len(robots), 3))
        for k, (i, m) in enumerate(zip(robots.tolist(), maps.tolist(), strict=True)):
            path, arc_m = self._mission(i, m, rng, turn)
            most_m = self._spread * START_OFFSET * self._half_widths_m[m]
            offset_m = rng.uniform(-most_m, most_m)
            most_rad = self._spread * START_HEADING_RAD
            heading_rad = rng.uniform(-most_rad, most_rad)
            poses[k] = self._follower.start(i, path, arc_m, offset_m, heading_rad)
            self._lengths_m[i] = path.length_m
        self._maps[robots], self._steps[robots] = maps, 0
        return Starts(poses, maps)

    def reset_at(self, robots: np.ndarray, poses: np.ndarray, rng: np.random.Generator) -> Starts:
        """Begin an episode for these robots (M,) at these poses (M, 3) of the only map.

        Raises:
            ConfigError: there are several maps, or a pose is off the road or turned away from it.
        """
        if len(self.road_maps) > 1:
            raise ConfigError(f"pose: expected to drive on one map, got {len(self.road_maps)}")
        for i, pose in zip(robots.tolist(), poses.tolist(), strict=True):
            path = self._path_from(Pose(*pose), rng)
            at = path.project(pose[0], pose[1])
            turned_rad = float(wrap_angle(pose[2] - at.heading_rad))
            most_m, most_rad = float(self._half_widths_m[0]), MAX_HEADING_ERROR_RAD
            if abs(at.offset_m) > most_m or abs(turned_rad) > most_rad:
                near = path.pose_at(at.arc_m)
                raise ConfigError(
                    f"pose: expected one within {most_m:.2f} m and {most_rad:.2f} rad of the lane, "
                    f"such as ({near.x_m:.2f}, {near.y_m:.2f}, {near.heading_rad:.2f}), got "
                    f"({pose[0]:.2f}, {pose[1]:.2f}, {pose[2]:.2f})"
                )
            self._follower.start(i, path, at.arc_m, at.offset_m, turned_rad)
            self._lengths_m[i] = path.length_m
        self._maps[robots], self._steps[robots] = 0, 0
        return Starts(poses, np.zeros(len(robots), dtype=int))

    def _path_from(self, pose: Pose, rng: np.random.Generator) -> Path:  # noqa: ARG002
        """The path of an episode that begins at a pose of the first map."""
        return self._mission(0, 0, rng, None)[0]

    @abstractmethod
    def step(self, poses: np.ndarray, collided: np.ndarray) -> TaskStep:
        """Reward and end of the decision that led to poses (N, 3)."""

    @abstractmethod
    def _mission(
        self, robot: int, road_map: int, rng: np.random.Generator, turn: int | None
    ) -> tuple[Path, float]:
        """The path of a robot's next episode on a map, and how far along it [m] it begins.

        ``turn``: what episodes on this map take in turn, their number there; None where they draw.
        """

    def _follow(self, poses: np.ndarray) -> tuple[Course, np.ndarray]:
        """One more decision: where it led to, and who (N,) has turned away from the path."""
        course = self._follower.follow(poses)
        self._steps += 1
        return course, np.abs(course.heading_error_rad) > MAX_HEADING_ERROR_RAD
