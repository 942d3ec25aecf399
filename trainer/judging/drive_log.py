"""Where evaluated robots drove, and what they saw when it went worst: what a report draws."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any
from zipfile import BadZipFile

import numpy as np

from robot.errors import ConfigError
from sim_pybullet.batch import BatchStep, BatchWorld, Observation
from sim_pybullet.tasks.following import MAX_HEADING_ERROR_RAD
from trainer.run import atomically

WORST = 10  # episodes whose frames are kept
STRIP_FRAMES = 8
STRIP_EVERY = 5  # decisions between two frames of a strip
SETTLED = 20  # decisions after which a robot should have got over where it was put

DONE = "done"


@dataclass(frozen=True, eq=False)
class Track:
    """One episode of one robot; row 0 is its start, and each decision led to one more."""

    seed: int
    map_index: int  # into the maps of the evaluation
    end: str  # `DONE`, or why it failed
    poses: np.ndarray  # (T, 3) float32: x [m], y [m], heading [rad], true ones
    offset_m: np.ndarray  # (T,) float32, from the path, positive to the left
    strip: np.ndarray  # (K, H, W, 3) uint8 up to the worst moment; K = 0 where none was kept

    @property
    def success(self) -> bool:
        """Whether the task was done."""
        return self.end == DONE

    @property
    def worst(self) -> int:
        """The row with the greatest distance from the path, once the robot was over its start."""
        first = min(SETTLED, len(self.offset_m) - 1)
        return first + int(np.abs(self.offset_m[first:]).argmax())

    @property
    def deviation_m(self) -> float:
        """That distance."""
        return float(abs(self.offset_m[self.worst]))

    @property
    def badness(self) -> tuple[bool, float]:
        """Larger is worse: failures first, then by deviation."""
        return (not self.success, self.deviation_m)


class DriveLog:
    """The tracks of an evaluation, with film strips of the worst."""

    def __init__(self, tracks: Sequence[Track] = ()) -> None:
        self._tracks = {track.seed: track for track in tracks}

    @property
    def tracks(self) -> list[Track]:
        """By seed."""
        return sorted(self._tracks.values(), key=lambda track: track.seed)

    @property
    def worst(self) -> list[Track]:
        """Those with a strip, the worst one first."""
        shown = [track for track in self._tracks.values() if len(track.strip)]
        return sorted(shown, key=lambda track: track.badness, reverse=True)

    def add(self, track: Track) -> None:
        """One more; where more than `WORST` have strips, the best of them loses its own."""
        self._tracks[track.seed] = track
        for spared in self.worst[WORST:]:
            self._tracks[spared.seed] = replace(spared, strip=spared.strip[:0])

    def save(self, path: Path) -> None:
        """Write a NumPy archive, atomically."""
        arrays: dict[str, Any] = {n: [getattr(t, n) for t in self.tracks] for n in _HEAD}
        for track in self.tracks:
            arrays[f"poses_{track.seed}"] = track.poses
            arrays[f"offset_m_{track.seed}"] = track.offset_m
            arrays[f"strip_{track.seed}"] = track.strip
        with atomically(path) as temporary, temporary.open("wb") as file:
            np.savez_compressed(file, **arrays)


_HEAD = ("seed", "map_index", "end")


def drives_beside(evaluation: Path) -> Path:
    """Where the drives of an evaluation, a JSON file, are kept."""
    return evaluation.with_suffix(".npz")


def load_drives(path: Path) -> DriveLog:
    """Read what `DriveLog.save` wrote; ConfigError if the file holds no drives."""
    try:
        with np.load(path) as file:
            return DriveLog(
                [
                    Track(*head, *(file[f"{n}_{head[0]}"] for n in ("poses", "offset_m", "strip")))
                    for head in zip(*(file[name].tolist() for name in _HEAD), strict=True)
                ]
            )
    except (OSError, EOFError, KeyError, ValueError, BadZipFile) as error:
        raise ConfigError(
            f"{path}: expected drives that evaluate --drives wrote, got: {error}"
        ) from error


class Tracer:
    """Follows the robots of a world with numbered episodes, and tells a log of each that ends."""

    def __init__(self, world: BatchWorld, log: DriveLog) -> None:
        self._world, self._log = world, log
        self._rides = [_Ride() for _ in range(world.n_robots)]

    def see(self, observation: Observation) -> None:
        """Before each decision: what the robots see, where they are."""
        world = self._world
        offset_m, maps, poses = world.task.course.offset_m, world.maps, world.poses
        for i in np.flatnonzero(world.active).tolist():
            self._rides[i].map_index = int(maps[i])
            self._rides[i].add(poses[i], float(offset_m[i]), observation.image[i, ..., -3:])

    def end(self, step: BatchStep, numbers: np.ndarray) -> None:
        """After each decision: the episodes that ended with it; they had these numbers (N,)."""
        for k, robot in enumerate(step.finished.robots.tolist()):
            ride, self._rides[robot] = self._rides[robot], _Ride()
            frame = step.finished.observation.image[k, ..., -3:]
            self._log.add(ride.end(int(numbers[robot]), step, robot, frame))


class _Ride:
    """An episode that goes on."""

    def __init__(self) -> None:
        self.map_index = 0
        self.poses: list[np.ndarray] = []
        self.offset_m: list[float] = []
        self.frames: list[np.ndarray] = []

    def add(self, pose: np.ndarray, offset_m: float, frame: np.ndarray) -> None:
        if len(self.poses) % STRIP_EVERY == 0:
            self.frames.append(frame.copy())
        self.poses.append(pose)
        self.offset_m.append(offset_m)

    def end(self, seed: int, step: BatchStep, robot: int, frame: np.ndarray) -> Track:
        self.poses.append(step.poses[robot])
        self.offset_m.append(float(step.course.offset_m[robot]))
        rows = (np.array(self.poses, np.float32), np.array(self.offset_m, np.float32))
        frames = np.stack([*self.frames, frame])
        track = Track(seed, self.map_index, _end(step, robot), *rows, frames)
        until = track.worst // STRIP_EVERY + 1 if track.success else len(frames)
        return replace(track, strip=frames[max(0, until - STRIP_FRAMES) : until])


def _end(step: BatchStep, robot: int) -> str:
    if step.task.success[robot]:
        return DONE
    if step.collided[robot]:
        return "collided"
    if not step.task.terminated[robot]:
        return "out of time"
    turned = abs(step.course.heading_error_rad[robot]) > MAX_HEADING_ERROR_RAD
    return "turned away" if turned else "left its path"
