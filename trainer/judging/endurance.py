"""How long a policy keeps its lane when nothing ends the drive but leaving it (paper A, 4.1).

Paper A lets its policies drive "indefinitely unless the program was manually interrupted"; here
they drive for a given time, through whole camera frames, greedily.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from robot.contract import CONTROL_DT_S
from robot.errors import ConfigError
from robot.inference.preprocess import preprocess_batch
from robot.navigation.road_map import RoadMap
from sim_pybullet.batch import BatchStep, BatchWorld
from sim_pybullet.pool import Looks
from sim_pybullet.tasks.lane_keeping import LaneKeeping
from trainer.judging.evaluate import DrivingPolicy


@dataclass(frozen=True)
class Endurance:
    """What ``--json`` writes."""

    robots: int
    hours: float  # asked for
    stayed: int  # robots that never left the lane
    shortest_h: float  # until the first of them left it, or all of the time
    driven_lane_m: float  # mean over the robots
    mean_path_distance_m: float
    largest_path_distance_m: float
    seed: int
    lane: str
    algorithm: str
    run: str
    schema: int = 1


def endure(
    policy: DrivingPolicy,
    road_maps: Sequence[RoadMap],
    looks: Looks,
    hours: float,
    robots: int,
    seed: int,
    driven: Callable[[], None],
    lane: str = "outer",
) -> Endurance:
    """Let so many robots drive for so long; one that leaves its lane is out.

    ``driven`` hears of every decision.

    Raises:
        ConfigError: no time, no robots, or no such lane.
        MapError: a map is not a ring of road.
    """
    decisions = round(hours * 3600.0 / CONTROL_DT_S) if math.isfinite(hours) else 0
    if decisions < 1 or robots < 1:
        raise ConfigError(f"expected hours and robots above 0, got {hours} and {robots}")
    task = LaneKeeping(road_maps, robots, lane, math.inf)
    world = BatchWorld(task, looks, seed=seed, pool_size=max(1, robots // len(road_maps)))
    record = _Record(robots)
    try:
        image = world.reset().image
        while record.staying.any() and record.decisions.max() < decisions:
            step = world.step(policy.act(preprocess_batch(image, policy.contract.image), None))
            image = step.observation.image
            record.add(step)
            driven()
    finally:
        world.close()
    contract = policy.contract
    return Endurance(
        robots=robots,
        hours=hours,
        stayed=int(record.staying.sum()),
        shortest_h=float(record.decisions.min()) * CONTROL_DT_S / 3600.0,
        driven_lane_m=float(record.travelled_m.mean()),
        mean_path_distance_m=float(record.offset_m.sum() / max(record.decisions.sum(), 1)),
        largest_path_distance_m=record.largest_m,
        seed=seed,
        lane=lane,
        algorithm=contract.algorithm,
        run=contract.run,
    )


class _Record:
    """What each of N robots did before it left its lane."""

    def __init__(self, robots: int) -> None:
        self.staying = np.ones(robots, dtype=bool)
        self.decisions = np.zeros(robots, dtype=int)
        self.travelled_m, self.offset_m = np.zeros(robots), np.zeros(robots)
        self.largest_m = 0.0

    def add(self, step: BatchStep) -> None:
        self.staying &= ~step.task.terminated
        self.decisions += self.staying
        offset_m = np.where(self.staying, np.abs(step.course.offset_m), 0.0)
        self.offset_m += offset_m
        self.largest_m = max(self.largest_m, float(offset_m.max()))
        self.travelled_m = np.where(self.staying, step.course.travelled_m, self.travelled_m)
