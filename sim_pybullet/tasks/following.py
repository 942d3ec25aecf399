"""Robots of the project on lanes of Duckietown maps, and the reward of paper A for being there."""

from collections.abc import Sequence

import numpy as np

from robot.contract import ACTION_TWISTS, CONTROL_DT_S, FIVE_ACTIONS, Action, ActionTable
from robot.errors import MapError
from robot.geometry import Pose
from robot.navigation.map_objects import blocked
from robot.navigation.path import Path
from robot.navigation.road_map import RoadMap
from sim_pybullet.motors import WheeledRobots
from sim_pybullet.tasks.spec import Course, Mission, Task, TaskStep

# From the middle of a lane to its edge: the yellow line begins at 0.18 tiles, the white at 0.193.
HALF_LANE_TILES = 0.19
NOMINAL_STEP_M = ACTION_TWISTS[Action.STRAIGHT].forward_mps * CONTROL_DT_S
DAWDLE = 2.0  # an episode may take this many times as long as driving straight ahead would
_CLEAR_M = 0.3  # nobody begins nearer to what stands in the lane


def following_terms(course: Course, half_lane_m: np.ndarray) -> np.ndarray:
    """Paper A's reward -5 |dE| + 5 dot of N robots as two terms (2, N), named as `Following` does.

    * ``offset``: -5 |dE|, dE the distance from the path in half-lane widths (N,) [m];
    * ``alignment``: 5 dot, dot the cosine between the headings of robot and path. Where it is
      positive it is earned by driving: times the progress along the path as a share (0 to 1) of
      what STRAIGHT makes in a decision (3 cm). A parked robot never gets more than zero in all.
    """
    dot = np.cos(course.heading_error_rad)
    speed = np.clip(course.progress_m / NOMINAL_STEP_M, 0.0, 1.0)
    offset = np.abs(course.offset_m) / half_lane_m
    return np.stack((-5.0 * offset, 5.0 * np.minimum(dot, dot * speed)))


class Following(Task):
    """A task whose robots are the project's, and whose reward is `following_terms`.

    An episode begins somewhere on one of the ``ways`` of a map, at random.
    """

    term_names: tuple[str, ...] = ("offset", "alignment")
    actions: ActionTable = FIVE_ACTIONS

    def __init__(
        self,
        road_maps: Sequence[RoadMap],
        n_robots: int,
        ways: Sequence[Sequence[Path]],
        start_spread: float,
    ) -> None:
        self._ways = ways
        self._blocked_m = [blocked(road_map, every=True).points_m for road_map in road_maps]
        half_lanes_m = HALF_LANE_TILES * np.array([m.tile_size_m for m in road_maps])
        vehicle = WheeledRobots(n_robots, self.actions)
        super().__init__(road_maps, vehicle, n_robots, half_lanes_m, ways[0][0], start_spread)

    def _mission(self, road_map: int, rng: np.random.Generator, turn: int | None) -> Mission:
        ways = self._ways[road_map]
        way = ways[int(rng.integers(len(ways))) if turn is None else turn % len(ways)]
        for _ in range(1000):
            arc_m = rng.uniform(0.0, way.length_m)
            away_m = self._blocked_m[road_map] - way.pose_at(arc_m)[:2]
            if (np.hypot(*away_m.T) > _CLEAR_M).all():
                return way, arc_m
        raise MapError(f"{self.road_maps[road_map].name}: expected room to begin, found none")

    def _path_from(self, pose: Pose, rng: np.random.Generator) -> Path:  # noqa: ARG002
        on = [way.project(pose.x_m, pose.y_m) for way in self._ways[0]]  # they cross in junctions
        away = [abs(at.offset_m) - 0.4 * np.cos(pose.heading_rad - at.heading_rad) for at in on]
        return self._ways[0][int(np.argmin(away))]

    def _followed(
        self, facts: np.ndarray, failed: np.ndarray, arrived: np.ndarray, laps: float = 1.0
    ) -> TaskStep:
        """A step by who (N,) has failed or arrived; so many ``laps`` of a path make an episode."""
        late = self._steps * NOMINAL_STEP_M >= DAWDLE * laps * self._lengths_m
        terms = following_terms(self.course, self.half_lane_m)
        return self._judged(terms, facts, (failed, arrived, late))
