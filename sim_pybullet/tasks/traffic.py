"""``Traffic``: drive among ducks that walk and cars with drivers of their own."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from robot.contract import CONTROL_DT_S, FIVE_ACTIONS, Action, ActionTable
from robot.errors import ConfigError
from robot.navigation.road_map import RoadMap
from sim_pybullet.motors import expert_actions
from sim_pybullet.tasks.following import NOMINAL_STEP_M, Following, following_terms
from sim_pybullet.tasks.spec import Choices, TaskSpec, TaskStep, expect_any, register
from sim_pybullet.traffic.ahead import behind
from sim_pybullet.traffic.crowd import STANDS_MPS, Approach, Body, Crowd
from sim_pybullet.traffic.drivers import GAP_M, LINE_S
from sim_pybullet.traffic.scenario import Scenario, load_scenario
from sim_pybullet.traffic.streets import Streets

EPISODE_S = 60.0
SLOW, STOP = len(FIVE_ACTIONS), len(FIVE_ACTIONS) + 1
SLOW_MPS = 0.12
# With two more: slow, straight on, and stop.
TRAFFIC_ACTIONS: ActionTable = (*FIVE_ACTIONS, (SLOW_MPS, SLOW_MPS), (0.0, 0.0))
FEWEST_TILES = 3.0  # who has not driven so far has not done what was asked
_NEAR_M = 0.3  # nearer than that to what is ahead one should not drive
_HEADWAY_S = 0.8  # of the expert
_LOOKAHEAD_M = 0.1  # nearer than elsewhere: within 3 cm of the middle, so that two can pass
_PENALTY = 20.0


class Traffic(Following):
    """Drive along a lane for a minute among the road users of a `Scenario`.

    Robots of one scenario (``robots_pcs``) share a world. The reward is that of
    `sim_pybullet.tasks.following.following_terms`, which a robot that stands never earns, less for
    driving nearer than 0.3 m to what is ahead, less for a collision by one's own fault.

    Terminated: in collision (0.10 m to a duck, 0.15 m to a robot, centre to centre; with things as
    bodies meet) or off the tiles of road. Truncated: after a minute, a success if the robot has
    driven three tiles along the lane.

    Facts: ``tiles`` driven along the lane; ``hit``, whom the collision was with, as
    `sim_pybullet.traffic.crowd.Body`, or 0; ``at_fault``: 0 where the other drove into a robot that
    stood, or from behind; ``free_m`` ahead along the lane, at most 1.04; ``least_ttc_s``,
    the least time to a collision with what was ahead, at these speeds, so far, at most a minute.

    ConfigError for no maps, or robots that do not fill the scenario's worlds; MapError for a map
    without room for it.
    """

    frames = 3
    actions = TRAFFIC_ACTIONS
    episode_s = EPISODE_S
    term_names: tuple[str, ...] = ("offset", "alignment", "nearness", "collision")
    fact_names: tuple[str, ...] = ("tiles", "hit", "at_fault", "free_m", "least_ttc_s")

    def __init__(
        self,
        road_maps: Sequence[RoadMap],
        n_robots: int,
        scenario: Scenario,
        start_spread: float = 1.0,
    ) -> None:
        expect_any("Traffic", road_maps, n_robots)
        self.group = len(scenario.robots_pcs)
        if n_robots % self.group:
            raise ConfigError(
                f"robots: expected a multiple of {self.group}, the robots_pcs of the scenario, "
                f"got {n_robots}"
            )
        self.streets = Streets(road_maps)
        self.crowd = Crowd(self.streets, scenario, n_robots // self.group)
        self.movers = self.crowd.movers
        super().__init__(self.streets.road_maps, n_robots, self.streets.tours, start_spread)
        self._poses = np.full((n_robots, 3), np.nan)
        self._velocities = np.zeros((n_robots, 2))
        self._least_ttc_s = np.full(n_robots, EPISODE_S)
        self._seen: Approach | None = None

    def reset(
        self, robots: np.ndarray, rng: np.random.Generator, number: int | None = None
    ) -> np.ndarray:
        """Begin an episode of whole groups of robots (M,)."""
        poses = np.zeros((len(robots), 3))
        for first in range(0, len(robots), self.group):
            k = int(rng.integers(len(self.road_maps)))
            k = k if number is None else number % len(self.road_maps)
            group = int(robots[first]) // self.group
            places = self.crowd.begin(group, k, rng, self._spread)
            for row, (path, *beside) in enumerate(places, first):
                self._start(int(robots[row]), path, k, *beside)
                poses[row] = places[row - first].pose
        self._begin(robots, poses)
        return poses

    def reset_at(self, robots: np.ndarray, poses: np.ndarray, rng: np.random.Generator) -> None:
        """Begin an episode of robots (M,) at poses (M, 3); ConfigError if they share worlds."""
        if self.group > 1:
            raise ConfigError("pose: expected a scenario of one robot of ours, got several")
        super().reset_at(robots, poses, rng)
        self._begin(robots, poses)
        for i, pose in zip(robots.tolist(), poses.tolist(), strict=True):
            self.crowd.begin(i, 0, rng, at_m=(pose[0], pose[1]))

    def _begin(self, robots: np.ndarray, poses: np.ndarray) -> None:
        self._poses[robots], self._velocities[robots] = poses, 0.0
        self._least_ttc_s[robots], self._seen = EPISODE_S, None

    def think(self, poses: np.ndarray) -> None:
        """Other road users decide."""
        self.crowd.think(self._grouped(poses), self._grouped(self._velocities), self.look(poses))

    def look(self, poses: np.ndarray) -> Approach:
        """What is ahead of all cars, ours at poses (N, 3) first; looked up once a decision."""
        if self._seen is None:
            here, moving = self._grouped(poses), self._grouped(self._velocities)
            self._seen = self.crowd.look(here, self.paths, self.course.arc_m, moving)
        return self._seen

    def moving(self, poses: np.ndarray, share: float = 1.0) -> np.ndarray:
        """As of `Task`."""
        return self.crowd.shown(self._grouped(poses), share).reshape(self.n_robots, -1, 3)

    def expert(self, poses: np.ndarray) -> np.ndarray:
        """(N,) what a driver would do who knows where everybody is."""
        choices = expert_actions(self.paths, poses, self.course.arc_m, _LOOKAHEAD_M)
        room_m = self.look(poses).free_m[:, : self.group] - GAP_M
        most = np.minimum(room_m / _HEADWAY_S, self.crowd.line_m / LINE_S).ravel()
        choices[(most < 0.2) & (choices == Action.STRAIGHT)] = SLOW
        choices[most < 0.1] = STOP
        return choices

    def step(self, poses: np.ndarray, collided: np.ndarray) -> TaskStep:
        """Reward and end of the decision that led to poses (N, 3)."""
        self._velocities = (poses - self._poses)[:, :2] / CONTROL_DT_S
        self._poses = poses.copy()
        course, _ = self._follow(poses)
        hit, at_fault = self._meet(poses, collided)
        self.met = hit > 0
        self._seen = None
        seen = self.look(poses)
        free_m, ttc_s = (each[:, : self.group].ravel() for each in (seen.free_m, seen.ttc_s))
        self._least_ttc_s = np.minimum(self._least_ttc_s, ttc_s)
        tiles = course.travelled_m / self.streets.tile_m[self.maps]
        off = ~self.streets.on_road(self.maps, poses[:, None, :2])[:, 0]
        speed = np.clip(course.progress_m / NOMINAL_STEP_M, 0.0, 1.0)
        nearness = -4.0 * speed * np.maximum(1.0 - free_m / _NEAR_M, 0.0)
        along = following_terms(course, self.half_lane_m)
        terms = np.vstack((along, nearness, -_PENALTY * at_fault))
        facts = np.stack((tiles, hit, at_fault, free_m, self._least_ttc_s))
        late = self._steps * CONTROL_DT_S >= self.episode_s - 1e-9
        failed = self.met | off
        judged = self._judged(terms, facts, (failed, np.zeros_like(late), late))
        return judged._replace(success=judged.truncated & (tiles >= FEWEST_TILES))

    def _meet(self, poses: np.ndarray, collided: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Whom each robot has met (N,), 0 for nobody, and whether that is its own fault (N,)."""
        bodies, robots = self.crowd.bodies(self._grouped(poses)), np.arange(self.n_robots)
        xy_m = np.repeat(bodies, self.group, axis=0)
        xy_m[robots, robots % self.group] = np.nan
        apart = np.hypot(*np.moveaxis(xy_m - poses[:, None, :2], -1, 0))
        near = apart < self.crowd.meet_m
        whom = np.where(near, apart, np.inf).argmin(axis=1)
        met = near.any(axis=1)
        hit = np.where(met, self.crowd.kinds[whom], np.where(collided, Body.THING, 0))
        stood = np.hypot(*self._velocities.T) < STANDS_MPS
        theirs = met & (stood | behind(poses, xy_m)[robots, whom])
        return hit, ((hit > 0) & ~theirs).astype(int)

    def _grouped(self, of_robots: np.ndarray) -> np.ndarray:
        """(N, ...) -> (G, P, ...)."""
        return of_robots.reshape(-1, self.group, *of_robots.shape[1:])


class GuidedTraffic(Traffic):
    """`Traffic` over junctions: the policy gets the path of its tour beside the picture."""

    guided = True


def _register(kind: type[Traffic], usual: str, **rest: Any) -> None:
    def make(maps: Sequence[RoadMap], robots: int, chosen: Choices) -> Traffic:
        return kind(maps, robots, load_scenario(chosen.scenario or usual), chosen.start_spread)

    register(TaskSpec(kind=kind, make=make, actions=TRAFFIC_ACTIONS, scenarios=True, **rest))


_register(
    Traffic,
    "mixed",
    name="traffic",
    title="Traffic",
    purpose="Lane keeping among ducks and cars: it may drive slowly, and stop.",
    map="loop",
    presets={"fast": {"learn": {"buffer": 20_000}}},  # 29 kB a stack of pictures, kept twice
    environments={"Traffic-v0": {}},
)
_register(
    GuidedTraffic,
    "lfvi",
    name="traffic_junctions",
    title="Traffic at junctions",
    purpose="Driving along a path (`path_input`) among ducks and cars, over junctions.",
    map="town",
    learned=False,
)
