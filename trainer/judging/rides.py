"""What robots did and saw in their episodes, and films of what went worst."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

import numpy as np

from robot.contract import CONTROL_DT_S
from sim_pybullet.batch import BatchStep, BatchWorld, Observation
from sim_pybullet.drive_metrics import DriveMetrics
from sim_pybullet.scenery.objects import Place
from sim_pybullet.tasks.following import MAX_HEADING_ERROR_RAD
from trainer.mp4 import enlarged, write_mp4

WORST = 5  # episodes that are filmed
FILM_S = 10.0  # of each, up to its end, or to where a robot that got there was farthest off
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


class Worst:
    """The worst of many episodes, each with a title and a film."""

    def __init__(self) -> None:
        self.kept: list[tuple[tuple[float, ...], str, Film]] = []  # by badness, the worst first

    def add(self, badness: tuple[float, ...], title: str, film: Film) -> None:
        """One more; larger is worse, and never the same twice. The best of them is forgotten."""
        some = [*self.kept, (badness, title, film)]
        self.kept = sorted(some, key=lambda each: each[0], reverse=True)[:WORST]

    def write(self, out: Path, prefix: str) -> list[tuple[str, Path]]:
        """Films in a folder in place of older ones, ``PREFIX_1_a_title.mp4`` the worst; `films`."""
        out.mkdir(parents=True, exist_ok=True)
        for _, old in films(out, prefix):
            old.unlink()
        for rank, (_, title, film) in enumerate(self.kept, start=1):
            path = out / f"{prefix}_{rank}_{title.replace(' ', '_')}.mp4"
            write_mp4(path, map(enlarged, film), 1.0 / CONTROL_DT_S)
        return films(out, prefix)


def films(folder: Path, prefix: str) -> list[tuple[str, Path]]:
    """Titles and files of what `Worst.write` wrote, the worst first."""
    found = sorted(folder.glob(f"{prefix}_[1-9]_*.mp4"))
    return [(path.stem[len(prefix) + 3 :].replace("_", " "), path) for path in found]


def films_of(evaluation: Path) -> tuple[Path, str]:
    """Folder and prefix of the films of an evaluation, a JSON file: they lie beside it."""
    return evaluation.parent, f"{evaluation.stem}_worst"
