"""``Navigation``: drive from a place to another by a planned path (paper A, section 3.3)."""

from collections import Counter
from collections.abc import Sequence

import numpy as np

from robot.errors import MapError, PlanError
from robot.geometry import Pose, bezier_points
from robot.navigation.navigator import ARRIVAL_M, OFF_PATH_TILES
from robot.navigation.path import Path
from robot.navigation.planner import LaneGraph, plan_route, route_between
from robot.navigation.road_map import RoadMap
from sim_pybullet.tasks.following import Following
from sim_pybullet.tasks.spec import Mission, PaperRow, TaskSpec, TaskStep, expect_any, register

SHORTEST_TILES = 3.0  # from start to destination, along the path
_DRAWS = 500  # of start and destination, before a map is given up


class Navigation(Following):
    """Drive from a random place of a random map to another one, along the planned path.

    Starts and destinations lie on any lane of any tile of road, at least three tiles of path apart;
    the route is `robot.navigation.planner`'s, of the fewest lanes. A robot starts at rest, a
    little off the path and its direction. The reward is that of
    `sim_pybullet.tasks.following.following_terms`.

    Terminated, by the limits at which a real robot gives up (`robot.navigation.navigator`): a
    quarter of a tile from the path, more than 100 degrees off, or in collision. Truncated: at the
    destination (success), or after twice the time that the path takes at full speed. An arrival is
    no terminal state, since it would end a stream of positive rewards and teach to dawdle.

    ConfigError for no maps or robots, MapError for a map without a route that is long enough.
    """

    guided = True
    fact_names: tuple[str, ...] = ("remaining_m",)

    def __init__(
        self, road_maps: Sequence[RoadMap], n_robots: int, start_spread: float = 1.0
    ) -> None:
        expect_any("Navigation", road_maps, n_robots)
        self._routes = [RandomRoutes(road_map) for road_map in road_maps]
        examples = [[routes.draw(np.random.default_rng(0))] for routes in self._routes]
        self._tile_sizes_m = np.array([road_map.tile_size_m for road_map in road_maps])
        super().__init__(road_maps, n_robots, examples, start_spread)

    def _mission(self, road_map: int, rng: np.random.Generator, turn: int | None) -> Mission:  # noqa: ARG002
        return self._routes[road_map].draw(rng), 0.0

    def _path_from(self, pose: Pose, rng: np.random.Generator) -> Path:
        return self._routes[0].draw(rng, pose)

    def step(self, poses: np.ndarray, collided: np.ndarray) -> TaskStep:
        """Reward and end of the decision that led to poses (N, 3)."""
        course, lost = self._follow(poses)
        remaining_m = self._lengths_m - course.arc_m
        astray = np.abs(course.offset_m) > OFF_PATH_TILES * self._tile_sizes_m[self.maps]
        return self._followed(remaining_m[None], collided | lost | astray, remaining_m <= ARRIVAL_M)


class RandomRoutes:
    """Random starts and destinations on one map, with the path between them, round what stands in
    a lane."""

    def __init__(self, road_map: RoadMap) -> None:
        self._graph = LaneGraph(road_map)
        self._shortest_m = SHORTEST_TILES * road_map.tile_size_m
        # Tiles are equally likely, not lanes: a crossing has twelve of them, a straight road two.
        tiles = [lane.tile for lane in self._graph.lanes]
        lanes_of = Counter(tiles)
        shares = np.array([1.0 / lanes_of[tile] for tile in tiles])
        shares[list(self._graph.closed)] = 0.0  # nobody begins or ends beside a thing
        self._likely = np.cumsum(shares / shares.sum())

    def draw(self, rng: np.random.Generator, begin: Pose | None = None) -> Path:
        """A path of at least `SHORTEST_TILES`, from a place on the road if one is given.

        MapError if none was found, PlanError if that place is off the road.
        """
        if begin is not None:  # says what is wrong with it
            plan_route(self._graph, begin, (begin.x_m, begin.y_m))
        for _ in range(_DRAWS):
            start, goal = np.searchsorted(self._likely, rng.random(2)).tolist()
            start_t, goal_t = rng.random(2).tolist()
            try:
                if begin is None:
                    route = route_between(self._graph, start, start_t, goal, goal_t)
                else:
                    control = self._graph.lanes[goal].control_points_m
                    place = bezier_points(control, np.array([goal_t]))[0]
                    route = plan_route(self._graph, begin, (float(place[0]), float(place[1])))
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


register(
    TaskSpec(
        name="navigation",
        title="Navigation",
        purpose=(
            "Navigation: drives along a planned path (`path_input`), late and drifting as its pose "
            "may be, by its picture.\nNothing tells it of other robots or of things on the road."
        ),
        kind=Navigation,
        map="arena",
        painted=144,
        # A run uses all its steps, the last ones to settle: few failures are left to learn from.
        presets={
            "fast": {
                "steps": 24_000,
                "start_spread": 4.0,
                "rate_left": 0.03,
                "evaluation": {
                    "episodes": 60,
                    "rounds": 3,
                    "every_steps": 8_000,
                    "every_share": 0.25,
                    "stop_after_perfect": 0,
                },
            }
        },
        paper={
            "dueling": PaperRow("not given", "1.5 M", "96.4 % of 1000"),
            "ppo": PaperRow("not given", "3 M", "66 % of 1000"),
        },
        environments={
            "Navigation-v0": {"pose_error": "none"},
            "NavigationArenaPose-v0": {"pose_error": "arena"},
        },
    )
)
