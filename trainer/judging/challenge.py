"""The AI Driving Olympics' challenges: who drives, episode by episode, and how each went."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from robot.contract import CONTROL_DT_S
from robot.navigation.road_map import RoadMap
from sim_pybullet.batch import BatchWorld
from sim_pybullet.episodes import Looks
from sim_pybullet.tasks.spec import Choices, find_task
from sim_pybullet.tasks.traffic import EPISODE_S, Traffic
from sim_pybullet.traffic.crowd import Body
from sim_pybullet.traffic.scenario import load_scenario
from trainer.judging import rides
from trainer.judging.drivers import Driver
from trainer.judging.evaluate import ROBOTS
from trainer.judging.olympics import SURVIVED, Episode, LaneRules, longest_wait_s
from trainer.judging.rides import Film

_FIRST_WORLD = 1_000_000_009  # seed of all worlds


def robots_of(challenge: str) -> int:
    """How many of ours share a world."""
    return len(load_scenario(challenge).robots_pcs)


def drive(
    driver: Driver,
    challenge: str,
    road_maps: Sequence[RoadMap],
    looks: Looks,
    seeds: Sequence[int],
    seconds: float = EPISODE_S,
    films: bool = True,
) -> Iterator[tuple[Episode, Film]]:
    """One episode of so many seconds for each seed, of all robots of ours that share a world.

    They come as each ends, with ``films`` of what the robot saw at its end: frames (H, W, 3) uint8
    RGB. Consecutive seeds take the maps
    in turn. MapError for a map without room for the challenge.
    """
    group = robots_of(challenge)
    robots = group * min(max(ROBOTS // group, 1), len(seeds))
    spec = find_task("traffic_junctions" if driver.guided else "traffic")
    task = spec.build(road_maps, robots, Choices(scenario=challenge))
    assert isinstance(task, Traffic)
    task.frames, task.episode_s = driver.frames, seconds
    numbers = [group * seed + k for seed in seeds for k in range(group)]
    world = BatchWorld(task, looks, driver.image, _FIRST_WORLD, numbers=numbers)
    rules = {road_map.name: LaneRules(road_map) for road_map in road_maps}
    for done, facts, ride in rides.drive(world, lambda seen: driver.choose(world, seen), films):
        poses, end = np.array(ride.poses), SURVIVED
        if done.failed:
            hit = int(facts["hit"])
            end = f"collision_{Body(hit).name.lower()}" if hit else "out_of_tile"
        lanes = rules[done.map]
        figures = lanes.figures(poses, CONTROL_DT_S)
        episode = Episode(
            *divmod(done.seed, group),
            end,
            bool(facts["at_fault"]),
            done.success,
            facts["least_ttc_s"],
            longest_wait_s(poses, CONTROL_DT_S),
            done.map,
            lanes.lines_run(poses, CONTROL_DT_S),
            figures.driven_lanedir_consec / lanes.tile_size_m,
            figures,
        )
        yield episode, tuple(ride.frames)
