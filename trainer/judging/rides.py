"""Robots drive numbered episodes; what each did and saw in its own."""

from collections import deque
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from robot.contract import CONTROL_DT_S
from sim_pybullet.batch import BatchStep, BatchWorld, DriveMetrics, Observation
from sim_pybullet.look import NOMINAL, Look
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
    end: str = ""  # `DONE`, or why it failed
    look: Look = NOMINAL

    def add(self, pose: np.ndarray, offset_m: float, frame: np.ndarray | None) -> None:
        """Before a decision: where it is, and what it sees, if that is kept."""
        self.poses.append(pose)
        if frame is not None:
            self.frames.append(frame.copy())
        if len(self.poses) > SETTLED and abs(offset_m) > self.farthest_m:
            self.farthest, self.farthest_m = tuple(self.frames), abs(offset_m)


class Drive(NamedTuple):
    """One episode."""

    seed: int
    success: bool
    metrics: DriveMetrics
    failed: bool = False  # off the lane, lost or in collision, not just out of time
    laps: float | None = None  # driven, where the task counts them
    collided: bool = False  # the drive ended in a collision
    map: str = ""
    lane: str | None = None  # of a ring


def drive(
    world: BatchWorld, choose: Callable[[Observation], np.ndarray], films: bool = True
) -> Iterator[tuple[Drive, dict[str, float], Ride]]:
    """The episodes of a world with numbered ones, as each ends; the world is closed after them.

    With the task's facts at its end, and the ride, with frames where ``films`` are asked for.
    ``choose`` gives what `BatchWorld.step` takes.
    """
    going = [Ride() for _ in range(world.n_robots)]
    try:
        seen = world.reset()
        while world.active.any():
            _see(world, going, seen, films)
            numbers, maps, looks = world.numbers, world.maps, world.looks
            step = world.step(choose(seen))
            seen = step.observation
            for k, robot in enumerate(step.finished.robots.tolist()):
                told = zip(world.task.fact_names, step.task.facts[:, robot].tolist(), strict=True)
                facts, failed = dict(told), bool(step.task.terminated[robot])
                done = Drive(
                    int(numbers[robot]),
                    bool(step.task.success[robot]),
                    step.finished.metrics[k],
                    failed,
                    facts.get("laps"),
                    failed and bool(step.collided[robot]),
                    world.task.road_maps[maps[robot]].name,
                )
                ride, going[robot] = going[robot], Ride()
                ride.poses.append(step.poses[robot])
                ride.end, ride.look = _end(step, robot), looks[robot]
                yield done, facts, ride
    finally:
        world.close()


def _see(world: BatchWorld, going: Sequence[Ride], seen: Observation, films: bool) -> None:
    offset_m, half_m, poses = world.task.course.offset_m, world.task.half_lane_m, world.poses
    for i in np.flatnonzero(world.active).tolist():
        going[i].half_lane_m = float(half_m[i])
        frame = seen.image[i, ..., -3:] if films else None
        going[i].add(poses[i], float(offset_m[i]), frame)


def _end(step: BatchStep, robot: int) -> str:
    if step.task.success[robot]:
        return DONE
    if step.collided[robot]:
        return "collided"
    if not step.task.terminated[robot]:
        return "out of time"
    turned = abs(step.course.heading_error_rad[robot]) > MAX_HEADING_ERROR_RAD
    return "turned away" if turned else "left its path"
