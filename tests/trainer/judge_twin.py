"""``python -m tests.trainer.judge_twin``: how near a fit comes to virtual robots that are known.

Robots are drawn from looks wider than ``randomised``, driven in the batched world under the arena's
pose errors, recorded, and fitted. With ``--processes`` the loop bench drives them by hand: robot,
localizer and monitor are processes, and the robot records as a real one does.
"""

from __future__ import annotations

import argparse
import math
import shutil
import subprocess
import sys
import tempfile
from dataclasses import asdict, dataclass, replace
from operator import attrgetter
from pathlib import Path

import numpy as np

from robot.command_line import OneLineParser, number, whole
from robot.errors import ConfigError
from robot.output import write_json, write_yaml
from sim_pybullet.look import NOMINAL, Look
from sim_pybullet.motors import PHYSICS_DT_S
from sim_pybullet.randomise import load_look_sampler
from sim_pybullet.virtual import world as virtual
from tests.trainer.virtual_drive import record_drive
from trainer.twin.camera import PX_PER_RAD
from trainer.twin.colours import members, seen_from
from trainer.twin.eye import WIDTH, cover_scene
from trainer.twin.fit import Twin, fit_twin, twin_pictures, write_twin_page
from trainer.twin.motion import NAMES, at_times, reckoned
from trainer.twin.recorded import Recorded, read_drive, read_drives

MAP = "rings/claw"
REPLAY_S, MISSION_S = 10.0, 30.0
LEAST_PIXELS = 100
ROTOR_LAG_S = 0.05  # of the virtual HAT's motors behind their driver's ramp
AIMS = {
    **{"camera_delay_ms": 20.0, "delays_ms": 20.0, "gain": 0.02, "trim": 0.005},
    **{
        "replay_cm": 5.0,
        "turn_gain": 0.02,
        "pitch_deg": 0.5,
        "middle_deg": 0.5,
        "height_mm": 3.0,
        "levels": 8.0,
    },
}


@dataclass(frozen=True)
class Errors:
    """Of one robot: found less true; NaN where the fit did not say."""

    camera_delay_ms: float
    delays_ms: float  # from a command to its picture: camera, motors and half of their lag
    gain: float
    trim: float
    turn_gain: float
    pitch_deg: float  # of the camera
    middle_deg: float  # of the ray through the middle of the picture
    height_mm: float
    levels: float  # greatest of any colour, in the twin's pictures of places that were recorded
    share: float  # of the pictures that the map explains
    replay_cm: float  # after 10 s of the recorded commands in the twin, less where it really ends
    nominal_cm: float  # likewise in the nominal look


def errors_of(twin: Twin, true: Look, drive: Recorded) -> Errors:
    """How far the likeliest look of a twin is from the true one."""
    look, told = twin.look, twin.found
    pitches = [x.camera.pitch_rad for x in (look, true)]
    focals = [PX_PER_RAD * x.camera.focal_scale for x in (look, true)]
    middles = [
        p - math.atan(x.camera.centre_down_px / f)
        for p, f, x in zip(pitches, focals, (look, true), strict=True)
    ]
    seen = "camera.pitch_rad" in told
    return Errors(
        camera_delay_ms=1e3 * (look.timing.camera_delay_s - true.timing.camera_delay_s)
        if "timing.camera_delay_s" in told
        else math.nan,
        delays_ms=1e3 * (_late_s(look) - _late_s(true)),
        gain=look.drive.gain - true.drive.gain,
        trim=look.drive.trim - true.drive.trim,
        turn_gain=look.drive.turn_gain - true.drive.turn_gain,
        pitch_deg=math.degrees(pitches[0] - pitches[1]) if seen else math.nan,
        middle_deg=math.degrees(middles[0] - middles[1]) if seen else math.nan,
        height_mm=1e3 * (look.camera.height_m - true.camera.height_m) if seen else math.nan,
        levels=_levels(twin, drive) if seen else math.nan,
        share=twin.camera.share,
        replay_cm=replayed_cm(look, true, drive.commands),
        nominal_cm=replayed_cm(NOMINAL, true, drive.commands),
    )


def as_bench_drives(true: Look, ramp_mps2: float, waits_s: float) -> Look:
    """This look as a robot of the loop bench has it, in the twin's terms.

    Its rotors lag and ramp by themselves, and what the look lags beyond the nominal one comes
    after them: lags add, less the second model's step. Pictures wait for the robot's next turn.
    """
    beyond = virtual.beyond_nominal(true.drive)
    lags = {
        name: ROTOR_LAG_S + max(getattr(beyond, name) - virtual.PHYSICS_DT_S, 0.0)
        for name in ("forward_lag_s", "turn_lag_s")
    }
    late_s = true.timing.camera_delay_s + waits_s
    return replace(
        true,
        drive=replace(true.drive, **lags, acceleration_mps2=ramp_mps2),
        timing=replace(true.timing, camera_delay_s=late_s),
    )


def replayed_cm(look: Look, true: Look, commands: np.ndarray) -> float:
    """How far from each other two robots end under commands (K, 2): the mean of all 10 s."""
    looks = [[getattr(each.drive, name) for name in NAMES] for each in (look, true)]
    tracks = reckoned(commands, np.array(looks))
    begin_s = np.arange(1.0, len(commands) * PHYSICS_DT_S - REPLAY_S, REPLAY_S)
    ends = []
    for track, (*_, delay_s) in zip(tracks, looks, strict=True):
        first, last = (at_times(track, begin_s + s, delay_s) for s in (0.0, REPLAY_S))
        ends.append(np.exp(-1j * first[:, 2]) * ((last - first)[:, :2] @ (1.0, 1j)))
    return float(100.0 * np.abs(ends[0] - ends[1]).mean())


def _late_s(look: Look) -> float:
    return look.timing.camera_delay_s + look.drive.delay_s + look.drive.turn_lag_s


def _levels(twin: Twin, drive: Recorded) -> float:
    """The greatest difference of a kind's median colour between recorded and twin's pictures."""
    scene = cover_scene(drive.road_map, float(twin.camera.values[WIDTH]))
    cover = seen_from(scene, twin.camera.values, twin.camera.poses)
    ours, worst = twin_pictures(twin, drive), 0.0
    for mask in members(cover).values():
        if mask.sum() >= LEAST_PIXELS:
            medians = [np.median(pictures[mask], axis=0) for pictures in (ours, twin.pictures)]
            worst = max(worst, float(np.abs(medians[0] - medians[1]).max()))
    return worst


def recorded(options: argparse.Namespace, look: Look, k: int, folder: Path) -> list[Recorded]:
    """About as many seconds of driving as are asked for, of the robot of this number."""
    folder.mkdir()
    seed, path = options.seed + k, folder / "drive.mcap"
    if not options.processes:
        return [read_drive(record_drive(look, MAP, options.seconds, seed, path))]
    write_yaml(file := folder / "look.yaml", look)
    call = [sys.executable, "-m", "tools.loop", "--map", MAP, "--look", str(file)]
    call += ["--driver", "expert", "--record", str(folder), "--seed", str(seed)]
    call += ["--missions", str(round(options.seconds / MISSION_S)), "--json", f"{folder}.json"]
    done = subprocess.run(call, capture_output=True, text=True, check=False)
    if done.returncode not in (0, 1):  # 1: not all arrived
        raise ConfigError(f"the loop bench ended with status {done.returncode}: {done.stderr}")
    if not (drives := sorted(folder.glob("*.mcap"))):  # as where a floor has the boards' colour
        print(f"{k}: not driven: {done.stderr.strip()[:120]}", flush=True)
        return []
    return read_drives(drives, print)


def judge(options: argparse.Namespace, folder: Path) -> list[Errors]:
    """Fit as many robots as are asked for."""
    found = []
    for k in range(options.first, options.first + options.robots):
        look = load_look_sampler(options.look)(np.random.default_rng((options.seed, k)))
        if not (drives := recorded(options, look, k, folder / str(k))):
            continue
        shutil.rmtree(folder / str(k))
        if options.processes:
            waits_s = np.mean([t.frame_age_s or 0.0 for each in drives for t in each.turns])
            look = as_bench_drives(look, drives[0].acceleration_mps2, float(waits_s))
        twin = fit_twin(drives)
        drive = max(drives, key=attrgetter("seconds"))
        found.append(errors_of(twin, look, drive))
        told = ", ".join(f"{name} {value:.3g}" for name, value in asdict(found[-1]).items())
        print(f"{k}: {told}", flush=True)
        if options.json:
            write_twin_page(twin, drive, options.json.parent / f"twin_{k}.html")
            write_json(options.json, {"errors": [asdict(each) for each in found]})
    return found


def main() -> int:
    """Print each robot's errors, and how many are within each aim."""
    parser = OneLineParser(prog="python -m tests.trainer.judge_twin", description=__doc__)
    parser.add_argument("--robots", type=whole(1, 1000), default=30)
    parser.add_argument("--first", type=whole(0, 1000), default=0, help="number of the first")
    parser.add_argument("--seconds", type=number(20, 600), default=90.0, help="of each drive")
    parser.add_argument("--look", default="wide/day", help="to draw robots from")
    parser.add_argument("--seed", type=whole(0, 2**31 - 1), default=0)
    parser.add_argument("--processes", action="store_true", help="recorded by the loop bench")
    parser.add_argument("--json", type=Path, help="write the figures, and pages beside them")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        found = [asdict(each) for each in judge(options, Path(folder))]
    for name, aim in AIMS.items():
        errors = np.abs([each[name] for each in found])
        within = int((errors <= aim).sum())
        print(f"{name}: {within} of {len(found)} within {aim:g}, median {np.nanmedian(errors):.3g}")
    print(f"nominal_cm: median {np.median([each['nominal_cm'] for each in found]):.3g}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
