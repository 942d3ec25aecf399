"""What robots did in their episodes: tracks for a report's maps, and films of what went worst."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple
from zipfile import BadZipFile

import numpy as np

from robot.contract import CONTROL_DT_S
from robot.errors import ConfigError
from sim_pybullet.batch import BatchStep, BatchWorld, Observation
from sim_pybullet.tasks.following import HALF_LANE_TILES, MAX_HEADING_ERROR_RAD
from trainer.mp4 import enlarged, write_mp4
from trainer.run import atomically

WORST = 5  # episodes that are filmed
FILM_S = 10.0  # of each, up to its end, or to where a robot that got there was farthest off
SETTLED = 20  # decisions after which a robot should have got over where it was put
DONE = "done"
_HEAD = ("seed", "map_index", "end")

Film = Sequence[np.ndarray]  # frames (H, W, 3) uint8 RGB, one each decision


class Track(NamedTuple):
    """One episode of one robot; row 0 is its start, and each decision led to one more."""

    seed: int
    map_index: int  # into the maps of the evaluation
    end: str  # `DONE`, or why it failed
    poses: np.ndarray  # (T, 3) float32: x [m], y [m], heading [rad], true ones
    offset_m: np.ndarray  # (T,) float32, from the path, positive to the left

    @property
    def success(self) -> bool:
        """Whether the task was done."""
        return self.end == DONE

    @property
    def deviation_m(self) -> float:
        """The greatest distance from the path, once the robot was over its start."""
        return float(np.abs(self.offset_m[min(SETTLED, len(self.offset_m) - 1) :]).max())

    @property
    def badness(self) -> tuple[float, ...]:
        """Larger is worse: failures first, then by deviation."""
        return (not self.success, self.deviation_m)


@dataclass
class Ride:
    """An episode that goes on."""

    map_index: int = 0
    poses: list[np.ndarray] = field(default_factory=list)
    offset_m: list[float] = field(default_factory=list)
    frames: deque[np.ndarray] = field(
        default_factory=lambda: deque(maxlen=round(FILM_S / CONTROL_DT_S))
    )
    farthest: Film = ()  # what was seen up to where it was farthest off
    most_m: float = 0.0

    def add(self, pose: np.ndarray, offset_m: float, frame: np.ndarray) -> None:
        """Before a decision: where it is, and what it sees."""
        self.poses.append(pose)
        self.offset_m.append(offset_m)
        self.frames.append(frame.copy())
        if len(self.poses) > SETTLED and abs(offset_m) > self.most_m:
            self.farthest, self.most_m = tuple(self.frames), abs(offset_m)


class Rides:
    """Follows the robots of a world with numbered episodes."""

    def __init__(self, world: BatchWorld) -> None:
        self._world = world
        self._rides = [Ride() for _ in range(world.n_robots)]

    def see(self, observation: Observation) -> None:
        """Before each decision: what the robots see."""
        world = self._world
        offset_m, maps, poses = world.task.course.offset_m, world.maps, world.poses
        for i in np.flatnonzero(world.active).tolist():
            self._rides[i].map_index = int(maps[i])
            self._rides[i].add(poses[i], float(offset_m[i]), observation.image[i, ..., -3:])

    def end(self, step: BatchStep, robot: int) -> Ride:
        """After the decision with which a robot's episode ended: all of it."""
        ride, self._rides[robot] = self._rides[robot], Ride()
        ride.poses.append(step.poses[robot])
        ride.offset_m.append(float(step.course.offset_m[robot]))
        return ride


class Worst:
    """The worst of many, each with a film."""

    def __init__(self) -> None:
        self.kept: list[tuple[tuple[float, ...], Any, Film]] = []  # badness, what; worst first

    def add(self, badness: tuple[float, ...], what: Any, film: Film) -> None:
        """One more; larger is worse, and never the same twice. The best of them is forgotten."""
        some = [*self.kept, (badness, what, film)]
        self.kept = sorted(some, key=lambda each: each[0], reverse=True)[:WORST]


class DriveLog:
    """The tracks of an evaluation, with films of the worst that failed or left their lane."""

    def __init__(self, tile_sizes_m: Iterable[float]) -> None:
        """``tile_sizes_m``: of each map."""
        self._half_lanes_m = [HALF_LANE_TILES * size_m for size_m in tile_sizes_m]
        self._tracks: list[Track] = []
        self._worst = Worst()

    def end(self, seed: int, why: str, ride: Ride) -> None:
        """The episode of this number is over."""
        rows = np.array(ride.poses, np.float32), np.array(ride.offset_m, np.float32)
        track = Track(seed, ride.map_index, why, *rows)
        self._tracks.append(track)
        if not track.success or track.deviation_m > self._half_lanes_m[track.map_index]:
            film = ride.farthest if track.success else tuple(ride.frames)
            self._worst.add((*track.badness, -seed), track, film)

    def save(self, evaluation: Path) -> None:
        """Write tracks and films beside an evaluation, a JSON file."""
        tracks = sorted(self._tracks, key=lambda track: track.seed)
        arrays: dict[str, Any] = {name: [getattr(t, name) for t in tracks] for name in _HEAD}
        for track in tracks:
            arrays[f"poses_{track.seed}"] = track.poses
            arrays[f"offset_m_{track.seed}"] = track.offset_m
        with atomically(drives_beside(evaluation)) as temporary, temporary.open("wb") as file:
            np.savez_compressed(file, **arrays)
        for old in evaluation.parent.glob(film_of(evaluation, "*").name):
            old.unlink()
        for _, track, film in self._worst.kept:
            write_film(film_of(evaluation, track.seed), film)


def drives_beside(evaluation: Path) -> Path:
    """Where the tracks of an evaluation are kept."""
    return evaluation.with_suffix(".npz")


def film_of(evaluation: Path, seed: object) -> Path:
    """Where the film of one of its episodes is kept, if it is one of the worst."""
    return evaluation.with_name(f"{evaluation.stem}_episode_{seed}.mp4")


def write_film(path: Path, film: Film) -> None:
    """As it was driven, at a size that can be watched."""
    write_mp4(path, map(enlarged, film), 1.0 / CONTROL_DT_S)


def load_drives(path: Path) -> list[Track]:
    """The tracks that `DriveLog.save` wrote, by seed; ConfigError if the file holds none."""
    try:
        with np.load(path) as file:
            return [
                Track(*head, *(file[f"{name}_{head[0]}"] for name in ("poses", "offset_m")))
                for head in zip(*(file[name].tolist() for name in _HEAD), strict=True)
            ]
    except (OSError, EOFError, KeyError, ValueError, BadZipFile) as error:
        raise ConfigError(
            f"{path}: expected drives that evaluate --drives wrote, got: {error}"
        ) from error


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
