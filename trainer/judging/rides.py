"""What robots did and saw in their episodes, and films of what went worst."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from robot.contract import CONTROL_DT_S
from sim_pybullet.batch import BatchStep, BatchWorld, Observation
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


class Rides:
    """Follows the robots of a world with numbered episodes."""

    def __init__(self, world: BatchWorld) -> None:
        self._world = world
        self._rides = [Ride() for _ in range(world.n_robots)]

    def see(self, observation: Observation) -> None:
        """Before each decision: what the robots see."""
        task, poses = self._world.task, self._world.poses
        offset_m, half_m = task.course.offset_m, task.half_lane_m
        for i in np.flatnonzero(self._world.active).tolist():
            self._rides[i].half_lane_m = float(half_m[i])
            self._rides[i].add(poses[i], float(offset_m[i]), observation.image[i, ..., -3:])

    def end(self, step: BatchStep, robot: int) -> Ride:
        """After the decision with which a robot's episode ended: all of it."""
        ride, self._rides[robot] = self._rides[robot], Ride()
        ride.poses.append(step.poses[robot])
        return ride


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


def end_of(step: BatchStep, robot: int) -> str:
    """`DONE`, or why a robot's episode ended."""
    if step.task.success[robot]:
        return DONE
    if step.collided[robot]:
        return "collided"
    if not step.task.terminated[robot]:
        return "out of time"
    turned = abs(step.course.heading_error_rad[robot]) > MAX_HEADING_ERROR_RAD
    return "turned away" if turned else "left its path"
