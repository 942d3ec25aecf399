"""The runtime drives laps through virtual hardware, in lock-step.

Town, motors, camera and time are virtual; from the frame to the bytes on the bus it is the robot.
"""

from __future__ import annotations

import argparse
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import numpy as np
from tqdm import tqdm

from robot.config import RobotConfig
from robot.contract import CONTROL_DT_S
from robot.geometry import Pose
from robot.navigation.road_map import load_map
from robot.output import expect_writable, write_json
from robot.parts import Tick
from robot.runtime.assemble import open_policy
from tools.lap_drive import LapDrive, LapRecord
from tools.loop.sites import sites_of
from tools.video import DriveFilm, Moment

BAR = "{l_bar}{bar}| {n:.2f}/{total:.2f} laps [{elapsed}<{remaining}]"


def tell(options: argparse.Namespace) -> int:
    """Drive as asked and say how it went; 0 when all laps were driven, 1 otherwise."""
    inputs = [options.model, Path(options.translator) if options.translator else None]
    expect_writable(options.json, options.video, inputs=inputs)
    figures = drive(options)
    if options.json:
        write_json(options.json, figures)
    print(
        f"{figures['laps']:.2f} of {options.laps:g} laps in {figures['seconds']:.0f} s, "
        f"{100 * figures['mean_path_distance_m']:.1f} cm from the lane's middle on average, "
        f"{figures['state']}: {figures['reason']}"
    )
    return 0 if figures["arrived"] else 1


def drive(options: argparse.Namespace) -> dict[str, Any]:
    """Drive as asked; the summary."""
    site = sites_of(options.look, options.seed)(0)
    policy = open_policy(RobotConfig(str(options.model), translator=options.translator or ""))
    lap_drive = LapDrive(load_map(options.map), site.look, policy, options.seed)
    with ExitStack() as stack:
        stack.callback(lap_drive.close)
        bar = stack.enter_context(
            tqdm(total=options.laps, desc="drive", bar_format=BAR, mininterval=0.5)
        )
        film = None
        if options.video:
            film = DriveFilm(options.video, options.model, CONTROL_DT_S)
            film.turn_to(lap_drive.world.scene.ground)
            stack.callback(film.close)

        def watch(tick: Tick, pose: Pose, record: LapRecord) -> None:
            bar.update(min(max(record.laps, bar.n), options.laps) - bar.n)
            if film is not None and tick.frame is not None:
                film.add(_moment(tick, tick.frame.image, pose, record, lap_drive))

        record = lap_drive.drive(options.laps, watch)
    return summary(record, options, site.name)


def _moment(
    tick: Tick, picture: np.ndarray, pose: Pose, record: LapRecord, drive: LapDrive
) -> Moment:
    """What a film shows of one turn of the loop."""
    return Moment(
        picture,
        pose,
        None,  # a lane keeper needs to believe nothing
        tick.verdict.state.value,
        tick.verdict.sentence,
        drive.lane.points_m[[*range(len(drive.lane.points_m)), 0]].tolist(),
        [] if tick.values is None else tick.values.tolist(),
        tick.action,
        f"lap {record.laps:.2f}",
    )


def summary(record: LapRecord, options: argparse.Namespace, site: str) -> dict[str, Any]:
    """The JSON of a drive."""
    rms = np.sqrt(np.mean(np.square(record.odometry_errors), axis=0))
    offsets_m = np.abs(record.offsets_m)
    arrived = record.laps >= options.laps
    stop = {"fault": record.reason, "latency_s": None, "state": record.state}
    inputs = {name: getattr(options, name) for name in ("map", "look", "laps", "seed")}
    return {
        "schema": 1,
        "inputs": {**inputs, "model": str(options.model), "translator": options.translator or ""},
        "site": site,
        "missions": 1,
        "arrived": int(arrived),
        "laps": record.laps,
        "seconds": record.seconds,
        "mean_path_distance_m": float(offsets_m.mean()),
        "max_path_distance_m": float(offsets_m.max()),
        "position_rms_m": float(rms[0]),  # of the step odometry, which nothing corrects here
        "heading_rms_rad": float(rms[1]),
        "lost_steps": list(record.lost_steps),
        "state": record.state,
        "reason": record.reason,
        "stops": [] if arrived else [stop],
    }
