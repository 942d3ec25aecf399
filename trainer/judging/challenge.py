"""The AI Driving Olympics' challenges: who drives, episode by episode, and how each went."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple, Protocol

import numpy as np

from robot.contract import CONTROL_DT_S
from robot.navigation.road_map import RoadMap
from sim_pybullet.batch import BatchWorld, Observation
from sim_pybullet.pool import Looks
from sim_pybullet.tasks.base import TaskStep
from sim_pybullet.tasks.lane_keeping import LaneKeeping
from trainer.judging.evaluate import ROBOTS, DrivingPolicy, _choose, _own_speeds
from trainer.judging.lane_rules import LaneFigures, LaneRules

EPISODE_S = 60.0
FILM_S = 10.0  # kept of each drive, its end
_FIRST_WORLD = 1_000_000_009  # seed of all worlds
SURVIVED = "time"


class Driver(Protocol):
    """Who drives all robots of a world."""

    guided: bool  # whether it gets a path

    def choose(self, world: BatchWorld, seen: Observation) -> np.ndarray:
        """(N,) numbers of actions, or (N, 2) shares of the greatest wheel speed."""


class Standing:
    """Never moves."""

    guided = False

    def choose(self, world: BatchWorld, seen: Observation) -> np.ndarray:  # noqa: ARG002
        """See `Driver`."""
        return np.zeros((world.n_robots, 2))


class Expert:
    """Follows the middle of the lane by true poses."""

    guided = False

    def choose(self, world: BatchWorld, seen: Observation) -> np.ndarray:  # noqa: ARG002
        """See `Driver`."""
        return world.expert_actions()


class Pilot:
    """A policy, greedily."""

    def __init__(self, policy: DrivingPolicy) -> None:
        self._policy = policy
        self.guided = policy.contract.path_points > 0

    def choose(self, world: BatchWorld, seen: Observation) -> np.ndarray:
        """See `Driver`."""
        choices = np.zeros(world.n_robots, dtype=int)
        for robot in np.flatnonzero(world.active).tolist():
            choices[robot] = _choose(self._policy, seen, robot, None)
        speeds = _own_speeds(self._policy, world)
        return choices if speeds is None else speeds[choices]


class LaneFollowing(LaneKeeping):
    """Drive along a lane for `EPISODE_S`; only who is off the tiles of the road, or hits, ends."""

    def __init__(self, road_maps: Sequence[RoadMap], n_robots: int, guided: bool = False) -> None:
        super().__init__(road_maps, n_robots, "both")
        self.guided = guided

    def step(self, poses: np.ndarray, collided: np.ndarray) -> TaskStep:
        """See `sim_pybullet.tasks.base.Task`; reward is none."""
        self._follow(poses)
        maps = [self.road_maps[k] for k in self._maps]
        off = [not m.on_road(x, y) for m, (x, y, _) in zip(maps, poses, strict=True)]
        late = self._steps * CONTROL_DT_S >= EPISODE_S - 1e-9
        nothing = np.zeros((len(self.term_names), self.n_robots))
        return self._judged(nothing, nothing[:1], (collided | off, late, late))


class Episode(NamedTuple):
    """One episode of one robot."""

    seed: int
    map: str
    end: str  # `SURVIVED`, or what ended it before its time
    figures: LaneFigures
    tiles: float  # along the lane

    @property
    def collided(self) -> bool:
        """Whether a collision of ours ended it."""
        return self.end.startswith("collision")


@dataclass
class _Ride:
    """An episode that goes on."""

    poses: list[np.ndarray] = field(default_factory=list)
    frames: deque[np.ndarray] = field(
        default_factory=lambda: deque(maxlen=round(FILM_S / CONTROL_DT_S))
    )


Heard = Callable[[Episode, Sequence[np.ndarray]], None]


def drive(
    driver: Driver, road_maps: Sequence[RoadMap], looks: Looks, seeds: Sequence[int], heard: Heard
) -> list[Episode]:
    """One episode for each seed; ``heard`` is told of each, and what the robot saw at its end.

    Consecutive seeds take the maps in turn, and both lanes of each. MapError for maps that are no
    rings of road.
    """
    task = LaneFollowing(road_maps, min(ROBOTS, len(seeds)), driver.guided)
    world = BatchWorld(task, looks, None, _FIRST_WORLD, numbers=seeds)
    rules = {road_map.name: LaneRules(road_map) for road_map in road_maps}
    found = []
    try:
        for episode, frames in _episodes(driver, world, rules):
            found.append(episode)
            heard(episode, frames)
    finally:
        world.close()
    return sorted(found)


def _episodes(
    driver: Driver, world: BatchWorld, rules: Mapping[str, LaneRules]
) -> Iterator[tuple[Episode, Sequence[np.ndarray]]]:
    """As each ends."""
    seen = world.reset()
    rides = [_Ride() for _ in range(world.n_robots)]
    while world.active.any():
        before, numbers, maps = world.poses, world.numbers, world.maps
        for robot in np.flatnonzero(world.active).tolist():
            rides[robot].poses.append(before[robot])
            rides[robot].frames.append(seen.image[robot, ..., -3:].copy())
        step = world.step(driver.choose(world, seen))
        seen = step.observation
        for robot in step.finished.robots.tolist():
            ride, rides[robot] = rides[robot], _Ride()
            road_map = world.task.road_maps[maps[robot]]
            poses = np.array([*ride.poses, step.poses[robot]])
            figures = rules[road_map.name].figures(poses, CONTROL_DT_S)
            tiles = figures.driven_lanedir_consec / road_map.tile_size_m
            end = SURVIVED
            if step.task.terminated[robot]:
                end = "collision_thing" if step.collided[robot] else "out_of_tile"
            yield Episode(int(numbers[robot]), road_map.name, end, figures, tiles), ride.frames
