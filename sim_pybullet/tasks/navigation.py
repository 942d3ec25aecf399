"""``Navigation``: drive from a place to another by a planned path (paper A, section 3.3)."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

import numpy as np

from robot.errors import ConfigError, MapError, PlanError
from robot.navigator import ARRIVAL_M, MAX_HEADING_ERROR_RAD, OFF_PATH_TILES
from robot.path import Path
from robot.path_batch import PathBatch
from robot.planner import LaneGraph, route_between
from robot.road_map import RoadMap
from sim_pybullet.tasks.base import Starts, TaskStep
from sim_pybullet.tasks.following import (
    DAWDLE,
    HALF_LANE_TILES,
    NOMINAL_STEP_M,
    START_HEADING_RAD,
    START_OFFSET,
    TERM_NAMES,
    Course,
    PathFollower,
    following_terms,
)
from sim_pybullet.vehicle import WheeledRobots

SHORTEST_TILES = 3.0  # from start to destination, along the path
_DRAWS = 500  # of start and destination, before a map is given up


class Navigation:
    """Drive from a random place of a random map to another one, along the planned path.

    Starts and destinations lie on any lane of any tile of road, at least three tiles of path apart;
    the route is `robot.planner`'s, of the fewest lanes. A robot starts at rest, a little off the
    path and its direction. The reward is that of `sim_pybullet.tasks.following.following_terms`.

    Terminated, by the limits at which a real robot gives up (`robot.navigator`): a quarter of a
    tile from the path, so over the middle of the yellow line or beside the road; more than 100
    degrees off; or in collision. Truncated: at the destination (success), or after twice the time
    that the path takes at full speed. An arrival is no terminal state, since it would end a stream
    of positive rewards and teach to dawdle.

    Args:
        road_maps: each episode is on one of them.
        n_robots: N.
        start_spread: how many times as far off the path and its direction robots start, for
            training. Good drivers hardly ever see the edge of the lane; there they learn to return.

    Raises:
        ConfigError: no maps or no robots.
        MapError: a map has no route that is long enough.
    """

    guided = True
    frames = 1
    term_names: tuple[str, ...] = TERM_NAMES
    fact_names: tuple[str, ...] = ("remaining_m",)

    def __init__(
        self, road_maps: Sequence[RoadMap], n_robots: int, start_spread: float = 1.0
    ) -> None:
        if not road_maps or n_robots < 1:
            raise ConfigError(
                "Navigation: expected at least one map and one robot, got "
                f"{len(road_maps)} maps, {n_robots} robots"
            )
        self.road_maps = tuple(road_maps)
        self.n_robots = n_robots
        self._most_off, self._most_rad = (
            start_spread * START_OFFSET,
            start_spread * START_HEADING_RAD,
        )
        self.vehicle = WheeledRobots(n_robots)
        self._routes = [RandomRoutes(road_map) for road_map in road_maps]
        examples = [routes.draw(np.random.default_rng(0)) for routes in self._routes]
        self._tile_sizes_m = np.array([road_map.tile_size_m for road_map in road_maps])
        self._follower = PathFollower(examples[0], n_robots)
        self._lengths_m = np.zeros(n_robots)
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
        return np.asarray(HALF_LANE_TILES * self._tile_sizes_m[self._maps])

    def reset(self, robots: np.ndarray, rng: np.random.Generator) -> Starts:
        """Begin an episode for these robots (M,) on a random map, with a random mission."""
        maps = rng.integers(len(self.road_maps), size=len(robots))
        poses = np.zeros((len(robots), 3))
        for k, (i, m) in enumerate(zip(robots.tolist(), maps.tolist(), strict=True)):
            path = self._mission(i, m, rng)
            most_m = self._most_off * HALF_LANE_TILES * self._tile_sizes_m[m]
            offset_m = rng.uniform(-most_m, most_m)
            heading_rad = rng.uniform(-self._most_rad, self._most_rad)
            poses[k] = self._follower.start(i, path, 0.0, offset_m, heading_rad)
            self._lengths_m[i] = path.length_m
        self._maps[robots], self._steps[robots] = maps, 0
        return Starts(poses, maps)

    def _mission(self, robot: int, road_map: int, rng: np.random.Generator) -> Path:  # noqa: ARG002
        """The path of a robot's next episode on a map."""
        return self._routes[road_map].draw(rng)

    def step(self, poses: np.ndarray, collided: np.ndarray) -> TaskStep:
        """Reward and end of the decision that led to poses (N, 3)."""
        course, half_lane_m = self._follower.follow(poses), self.half_lane_m
        remaining_m = self._lengths_m - course.arc_m
        self._steps += 1
        lost = np.abs(course.heading_error_rad) > MAX_HEADING_ERROR_RAD
        astray = np.abs(course.offset_m) > OFF_PATH_TILES * self._tile_sizes_m[self._maps]
        terminated = collided | lost | astray
        success = ~terminated & (remaining_m <= ARRIVAL_M)
        late = self._steps * NOMINAL_STEP_M >= DAWDLE * self._lengths_m
        terms = following_terms(course, half_lane_m)
        truncated = ~terminated & (success | late)
        return TaskStep(terms, remaining_m[None], terminated, truncated, success)


class RandomRoutes:
    """Random starts and destinations on one map, with the path between them.

    Raises:
        MapError: the map has no road.
    """

    def __init__(self, road_map: RoadMap) -> None:
        self._graph = LaneGraph(road_map)
        self._shortest_m = SHORTEST_TILES * road_map.tile_size_m
        # Tiles are equally likely, not lanes: a crossing has twelve of them, a straight road two.
        tiles = [(lane.tile_row, lane.tile_column) for lane in self._graph.lanes]
        lanes_of = Counter(tiles)
        shares = np.array([1.0 / lanes_of[tile] for tile in tiles])
        self._likely = np.cumsum(shares / shares.sum())

    def draw(self, rng: np.random.Generator) -> Path:
        """A path of at least `SHORTEST_TILES`.

        Raises:
            MapError: none was found.
        """
        for _ in range(_DRAWS):
            start, goal = np.searchsorted(self._likely, rng.random(2)).tolist()
            start_t, goal_t = rng.random(2).tolist()
            try:
                route = route_between(self._graph, start, start_t, goal, goal_t)
            except PlanError:
                continue
            path = Path.from_beziers(route.curves_m)
            if path.length_m >= self._shortest_m:
                return path
        road_map = self._graph.road_map
        raise MapError(
            f"{road_map.name}: expected two places {SHORTEST_TILES:g} tiles of road apart, found "
            f"none; use a map with more road, such as the shipped map arena"
        )
