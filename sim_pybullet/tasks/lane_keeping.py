"""``LaneKeeping``: drive along one lane of a ring of road (paper A, section 3.2)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

import numpy as np

from robot.errors import ConfigError
from robot.path import lane_loop
from robot.path_batch import PathBatch
from robot.road_map import RoadMap
from sim_pybullet.tasks.base import Starts, TaskStep
from sim_pybullet.tasks.following import (
    DAWDLE,
    HALF_LANE_TILES,
    MAX_HEADING_ERROR_RAD,
    NOMINAL_STEP_M,
    START_HEADING_RAD,
    START_OFFSET,
    TERM_NAMES,
    Course,
    PathFollower,
    following_terms,
)
from sim_pybullet.vehicle import WheeledRobots


class LaneKeeping:
    """Drive ``laps`` laps along the middle of the outer lane, or of the inner one.

    An episode begins at a random place of the lane, a little off its middle and its direction. The
    reward is that of `sim_pybullet.tasks.following.following_terms`.

    Terminated: more than half a lane (0.19 tiles) from the middle, more than 100 degrees off, or in
    collision. Truncated: all laps driven (success), or twice the time that they take at full speed.

    Args:
        road_maps: rings of road; each episode is on one of them.
        n_robots: N.
        lane: which one.
        laps: of an episode.

    Raises:
        ConfigError: no maps, no robots or no laps.
        MapError: a map is not a ring of road.
    """

    guided = False
    frames = 1
    term_names: tuple[str, ...] = TERM_NAMES
    fact_names: tuple[str, ...] = ("laps",)

    def __init__(
        self,
        road_maps: Sequence[RoadMap],
        n_robots: int,
        lane: Literal["outer", "inner"] = "outer",
        laps: float = 2.0,
    ) -> None:
        if not road_maps or n_robots < 1 or laps <= 0.0:
            raise ConfigError(
                "LaneKeeping: expected at least one map, one robot and laps above 0, got "
                f"{len(road_maps)} maps, {n_robots} robots, {laps} laps"
            )
        self.road_maps = tuple(road_maps)
        self.n_robots = n_robots
        self.vehicle = WheeledRobots(n_robots)
        self._loops = [lane_loop(road_map, outer=lane == "outer") for road_map in road_maps]
        self._half_lanes_m = np.array([HALF_LANE_TILES * m.tile_size_m for m in road_maps])
        self._lengths_m = np.array([loop.length_m for loop in self._loops])
        self._laps = laps
        self._follower = PathFollower(self._loops[0], n_robots)
        self._maps = np.zeros(n_robots, dtype=int)
        self._steps = np.zeros(n_robots, dtype=int)

    @property
    def paths(self) -> PathBatch:
        """The lane that each robot is in."""
        return self._follower.paths

    @property
    def course(self) -> Course:
        """Where each robot is in its lane."""
        return self._follower.course

    @property
    def half_lane_m(self) -> np.ndarray:
        """(N,) distance from the middle of the lane to its edge."""
        return np.asarray(self._half_lanes_m[self._maps])

    def reset(self, robots: np.ndarray, rng: np.random.Generator) -> Starts:
        """Begin an episode for these robots (M,) on a random map, at a random place."""
        maps = rng.integers(len(self.road_maps), size=len(robots))
        poses = np.zeros((len(robots), 3))
        for k, (i, m) in enumerate(zip(robots.tolist(), maps.tolist(), strict=True)):
            loop, most_m = self._loops[m], START_OFFSET * self._half_lanes_m[m]
            poses[k] = self._follower.start(
                i,
                loop,
                rng.uniform(0.0, loop.length_m),
                rng.uniform(-most_m, most_m),
                rng.uniform(-START_HEADING_RAD, START_HEADING_RAD),
            )
        self._maps[robots], self._steps[robots] = maps, 0
        return Starts(poses, maps)

    def step(self, poses: np.ndarray, collided: np.ndarray) -> TaskStep:
        """Reward and end of the decision that led to poses (N, 3)."""
        course, half_lane_m = self._follower.follow(poses), self.half_lane_m
        laps = course.travelled_m / self._lengths_m[self._maps]
        self._steps += 1
        lost = np.abs(course.heading_error_rad) > MAX_HEADING_ERROR_RAD
        terminated = collided | lost | (np.abs(course.offset_m) > half_lane_m)
        success = ~terminated & (laps >= self._laps)
        full_speed_m = self._steps * NOMINAL_STEP_M
        late = full_speed_m >= DAWDLE * self._laps * self._lengths_m[self._maps]
        terms = following_terms(course, half_lane_m)
        truncated = ~terminated & (success | late)
        return TaskStep(terms, laps[None], terminated, truncated, success)
