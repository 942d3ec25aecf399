"""The AI Driving Olympics' challenges: who drives, episode by episode, and how each went."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from robot.contract import CONTROL_DT_S
from robot.navigation.road_map import RoadMap
from sim_pybullet.batch import BatchStep, BatchWorld
from sim_pybullet.pool import Looks
from sim_pybullet.tasks.spec import Choices, find_task
from sim_pybullet.traffic.crowd import Body
from sim_pybullet.traffic.scenario import load_scenario
from trainer.judging.drivers import Driver
from trainer.judging.evaluate import ROBOTS
from trainer.judging.lane_rules import LaneFigures, LaneRules
from trainer.judging.rides import Film, Rides

_FIRST_WORLD = 1_000_000_009  # seed of all worlds
SURVIVED = "time"


class Episode(NamedTuple):
    """One episode of one robot."""

    seed: int
    robot: int  # of those that share a world
    end: str  # `SURVIVED`, or what ended it before its time
    at_fault: bool  # in the collision that ended it
    success: bool  # survived, and drove three tiles
    least_ttc_s: float  # time to collision, the least
    map: str
    lines_run: int  # red lines at which it did not stand
    tiles: float  # along the lane
    figures: LaneFigures


def robots_of(challenge: str) -> int:
    """How many of ours share a world."""
    return len(load_scenario(challenge).robots_pcs)


def drive(
    driver: Driver,
    challenge: str,
    road_maps: Sequence[RoadMap],
    looks: Looks,
    seeds: Sequence[int],
) -> Iterator[tuple[Episode, Film]]:
    """One episode for each seed, of all robots of ours that share a world, as each ends.

    With what the robot saw at its end: frames (H, W, 3) uint8 RGB. Consecutive seeds take the maps
    in turn. MapError for a map without room for the challenge.
    """
    group = robots_of(challenge)
    robots = group * min(max(ROBOTS // group, 1), len(seeds))
    spec = find_task("traffic_junctions" if driver.guided else "traffic")
    task = spec.build(road_maps, robots, Choices(scenario=challenge))
    numbers = [group * seed + k for seed in seeds for k in range(group)]
    world = BatchWorld(task, looks, driver.image, _FIRST_WORLD, numbers=numbers)
    try:
        yield from _episodes(driver, world, {m.name: LaneRules(m) for m in road_maps})
    finally:
        world.close()


def _episodes(
    driver: Driver, world: BatchWorld, rules: Mapping[str, LaneRules]
) -> Iterator[tuple[Episode, Film]]:
    seen = world.reset()
    rides = Rides(world)
    while world.active.any():
        rides.see(seen)
        numbers, maps = world.numbers, world.maps
        step = world.step(driver.choose(world, seen))
        seen = step.observation
        for robot in step.finished.robots.tolist():
            ride, road_map = rides.end(step, robot), world.task.road_maps[maps[robot]]
            poses = np.array(ride.poses)
            figures = rules[road_map.name].figures(poses, CONTROL_DT_S)
            tiles = figures.driven_lanedir_consec / road_map.tile_size_m
            run = rules[road_map.name].lines_run(poses, CONTROL_DT_S)
            number = int(numbers[robot])
            lane = road_map.name, run, tiles, figures
            yield _episode(world, step, robot, number, lane), tuple(ride.frames)


def _episode(
    world: BatchWorld, step: BatchStep, robot: int, number: int, lane: tuple[Any, ...]
) -> Episode:
    """Of a robot that ended, whose episode had this number."""
    facts = dict(zip(world.task.fact_names, step.task.facts[:, robot].tolist(), strict=True))
    end = SURVIVED
    if step.task.terminated[robot]:
        hit = int(facts["hit"])
        end = f"collision_{Body(hit).name.lower()}" if hit else "out_of_tile"
    seed, place = divmod(number, world.task.group)
    fault, success = bool(facts["at_fault"]), bool(step.task.success[robot])
    return Episode(seed, place, end, fault, success, facts["least_ttc_s"], *lane)
