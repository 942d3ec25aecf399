"""Recordings as arrays: commands, pictures, and what told the robot where it was."""

import json
from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import accumulate
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from robot.camera.source import fit_to_frame
from robot.errors import ConfigError, ContractError, DuckpilotError
from robot.navigation.road_map import RoadMap, load_map
from robot.recording import topics
from robot.recording.drive_file import picture
from robot.recording.reader import entries, kept, read_about, read_pieces, turn_of
from sim_pybullet.look import DriveLook
from sim_pybullet.motors import PHYSICS_DT_S

LEAST_S, ALL_S, _CUT_S = 8.0, 20.0, 0.5  # of a drive; of all; without a turn: it was cut out


class Recorded(NamedTuple):
    """One drive. Times [s] are of the robot's clock, from the first turn on."""

    map_name: str  # "": none
    commands: np.ndarray  # (K, 2) rim speeds [m/s] after the ramp, each `PHYSICS_DT_S`; NaN: cut
    times_s: np.ndarray  # (F,) of the turns that saw a picture first
    images: np.ndarray  # (F, 120, 160, 3) uint8 RGB, fresh ones
    overhead: np.ndarray  # (M, 4) when it saw the robot, x, y, heading; empty without a map
    fused: np.ndarray  # (T, 4) the same, as the robot believed
    skipped: float  # share of the turns that saw the picture before once more
    turns: tuple[topics.Turn, ...]  # of each picture
    acceleration_mps2: float = DriveLook.acceleration_mps2

    @property
    def road_map(self) -> RoadMap:
        """Where it was driven."""
        return load_map(self.map_name)

    @property
    def seconds(self) -> float:
        """How long it lasted."""
        return np.isfinite(self.commands[:, 0]).sum() * PHYSICS_DT_S


class UnfitError(ConfigError):
    """A recording that tells too little."""


def read_drives(paths: Sequence[Path], tell: Callable[[str], object]) -> list[Recorded]:
    """Those that tell enough; of the others it is told why not. ConfigError if none is left."""
    drives = []
    for path in paths:
        try:
            drives.append(read_drive(path))
        except UnfitError as error:
            tell(f"left out: {error}")
    if (seconds := sum(each.seconds for each in drives)) < ALL_S:
        raise ConfigError(f"expected {ALL_S:g} s and more of drives, got {seconds:.0f} s")
    return drives


def read_drive(path: Path) -> Recorded:
    """UnfitError: too short, or on a map without any pose; DuckpilotError: none of a robot."""
    turns, frames, marks = list[topics.Turn](), dict[int | None, bytes](), read_pieces(path)
    overhead, fused = list[list[float]](), list[list[float]]()
    try:
        for entry in entries(path, topics.CAMERA, topics.TURN, topics.OVERHEAD, topics.POSE):
            if entry.topic == topics.CAMERA.name:
                frames[entry.number] = topics.image_bytes(entry.message())
            elif entry.topic == topics.TURN.name:
                turn, good = turn_of(path, entry), kept(marks, entry.topic, entry.time_s)
                turns.append(turn if good else replace(turn, state=""))
            elif entry.topic == topics.POSE.name:
                fused.append([turns[-1].time_s, *_place(entry.message())])
            elif turns[-1].pose_age_s is not None and (message := entry.message())["heading_known"]:
                overhead.append([turns[-1].time_s - turns[-1].pose_age_s, *_place(message)])
        about = read_about(path)
        map_name, hat = about.get("map", ""), json.loads(about.get("config", "{}")).get("hat", {})
    except (ValueError, LookupError, TypeError, AttributeError) as error:
        wrong = f"{path}: expected a robot's recording, got: {error!r}"
        raise error if isinstance(error, DuckpilotError) else ContractError(wrong) from error
    seconds = turns[-1].time_s - turns[0].time_s if turns else 0.0
    if seconds < LEAST_S or not frames or (map_name and not (overhead or fused)):
        wanted = f"expected {LEAST_S:g} s and more of driving, on a map with poses"
        got = f"{seconds:.0f} s, map {map_name or 'none'}, {len(overhead) + len(fused)} poses"
        raise UnfitError(f"{path}: {wanted}, got {got}")
    turned_s = np.array([t.time_s for t in turns]) - (at_s := turns[0].time_s)
    grid_s = (np.arange(round(turned_s[-1] / PHYSICS_DT_S) + 1) + 0.5) * PHYSICS_DT_S
    seen = [frames.get(turn.frame) for turn in turns]
    fresh = [t for k, t in enumerate(turns) if seen[k] not in (None, *seen[max(k - 1, 0) : k])]
    images = [fit_to_frame(picture(frames[turn.frame])) for turn in fresh]
    above, own = (np.reshape(t, (-1, 4)) - (at_s, 0.0, 0.0, 0.0) for t in (overhead, fused))
    step = PHYSICS_DT_S * (most := float(hat.get("acceleration_mps2", DriveLook.acceleration_mps2)))
    last = np.searchsorted(turned_s, grid_s, "right") - 1
    asked = np.array([t.wheels for t in turns])[last]
    asked[np.diff(turned_s, append=turned_s[-1])[last] > _CUT_S] = np.nan  # no ramp goes over it
    ramp = accumulate(asked, lambda v, new: 0.0 * new + np.fmin(np.fmax(new, v - step), v + step))
    skipped = 1.0 - len(fresh) / max(1, sum(t.frame is not None for t in turns))
    told = np.array(images), above, own, skipped, tuple(fresh), most
    return Recorded(map_name, np.array([*ramp]), np.array([t.time_s - at_s for t in fresh]), *told)


def _place(message: dict[str, Any]) -> tuple[float, float, float]:
    at, turned = message["pose"]["position"], message["pose"]["orientation"]
    return at["x"], at["y"], 2.0 * float(np.arctan2(turned["z"], turned["w"]))
