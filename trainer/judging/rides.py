"""Robots drive numbered episodes; what each did and saw in its own."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from robot.contract import CONTROL_DT_S
from sim_pybullet.batch import BatchStep, BatchWorld, Observation
from sim_pybullet.drive_metrics import DriveMetrics
from sim_pybullet.scenery.objects import Place
from sim_pybullet.tasks.following import MAX_HEADING_ERROR_RAD

FILM_S = 10.0  # of what a robot saw is kept
SETTLED = 20  # decisions after which a robot should have got over where it was put
DONE = "done"

Film = Sequence[np.ndarray]  # frames (H, W, 3) uint8 RGB, one each decision


@dataclass
class Ride:
    """One robot's episode that goes on."""

    poses: list[np.ndarray] = field(default_factory=list)
    frames: deque[np.ndarray] = field(
        default_factory=lambda: deque(maxlen=round(FILM_S / CONTROL_DT_S))
    )
    farthest: Film = ()  # what was seen up to where it was farthest off
    farthest_m: float = 0.0  # from its path, once it was over its start
    half_lane_m: float = 0.0

    def add(self, pose: np.ndarray, offset_m: float, frame: np.ndarray) -> None:
        """Before a decision: where it is, and what it sees."""
        self.poses.append(pose)
        self.frames.append(frame.copy())
        if len(self.poses) > SETTLED and abs(offset_m) > self.farthest_m:
            self.farthest, self.farthest_m = tuple(self.frames), abs(offset_m)


class Ended(NamedTuple):
    """A robot's episode that is over."""

    number: int
    place: Place
    end: str  # `DONE`, or why it failed
    success: bool
    terminated: bool
    collided: bool
    facts: dict[str, float]  # of the task
    metrics: DriveMetrics
    ride: Ride  # empty, where none was asked for


def drive(
    world: BatchWorld, choose: Callable[[Observation], np.ndarray], rides: bool = True
) -> Iterator[Ended]:
    """All episodes of a world with numbered ones, as each ends; the world is closed after them.

    ``choose`` gives what `BatchWorld.step` takes. ``rides``: whether to keep them.
    """
    going = [Ride() for _ in range(world.n_robots)]
    try:
        seen = world.reset()
        while world.active.any():
            if rides:
                _see(world, going, seen)
            numbers, maps = world.numbers, world.maps
            step = world.step(choose(seen))
            seen = step.observation
            for k, robot in enumerate(step.finished.robots.tolist()):
                facts = zip(world.task.fact_names, step.task.facts[:, robot].tolist(), strict=True)
                ride, going[robot] = going[robot], Ride()
                ride.poses.append(step.poses[robot])
                yield Ended(
                    int(numbers[robot]),
                    world.task.road_maps[maps[robot]],
                    _end(step, robot),
                    bool(step.task.success[robot]),
                    bool(step.task.terminated[robot]),
                    bool(step.collided[robot]),
                    dict(facts),
                    step.finished.metrics[k],
                    ride,
                )
    finally:
        world.close()


def _see(world: BatchWorld, going: Sequence[Ride], seen: Observation) -> None:
    offset_m, half_m, poses = world.task.course.offset_m, world.task.half_lane_m, world.poses
    for i in np.flatnonzero(world.active).tolist():
        going[i].half_lane_m = float(half_m[i])
        going[i].add(poses[i], float(offset_m[i]), seen.image[i, ..., -3:])


def _end(step: BatchStep, robot: int) -> str:
    if step.task.success[robot]:
        return DONE
    if step.collided[robot]:
        return "collided"
    if not step.task.terminated[robot]:
        return "out of time"
    turned = abs(step.course.heading_error_rad[robot]) > MAX_HEADING_ERROR_RAD
    return "turned away" if turned else "left its path"
