"""``python -m tests.trainer.judge_teach_loop FOLDER``: judge_teach's floors, by real processes.

On each floor the loop bench drives missions by hand and records them as the robot does, ``teach``
learns from these recordings, and base and taught policy are judged on virtual hardware: a lane
keeper by laps, a navigator by missions with robot, localizer and monitor as processes. FOLDER keeps
all of it: a later call goes on, and ``--record-only`` is for one that records ahead.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
from dataclasses import asdict, dataclass
from pathlib import Path

from robot.command_line import OneLineParser, answer, whole
from robot.errors import ConfigError
from robot.inference.policy import OnnxPolicy, open_policy
from robot.navigation.road_map import load_map
from robot.output import write_json, write_yaml
from sim_pybullet.look import NOMINAL, Look
from tests.trainer.judge_teach import CAMERAS, FIRST, SITES, floors
from tools.loop.laps import LapDrive
from trainer.twin.cli import teach_command
from trainer.twin.teach import base_file

INPUTS = ("base", "map", "missions", "judged", "seed")  # of what a folder holds
LAPS = 2.0  # of each drive, as the proof's


@dataclass(frozen=True)
class Driven:
    """How often a policy came to the end."""

    done: int  # laps, or missions,
    asked: int  # of so many
    drives: int  # that reached their end


@dataclass(frozen=True)
class Floor:
    """What teaching did to one floor."""

    floor: str
    seconds: float  # of driving that was recorded
    before: Driven
    after: Driven
    nominal_after: Driven
    forecast: int  # of 100 drives, in its twin
    armed: bool  # whether the robot would


def bench(options: argparse.Namespace, look: Path, out: Path, *more: str) -> dict[str, object]:
    """The figures of missions through the real processes; goes on with those that are there."""
    call = (sys.executable, "-m", "tools.loop", "--map", options.map, "--look", str(look), *more)
    done = subprocess.run((*call, "--json", str(out)), stdout=subprocess.DEVNULL, check=False)
    if done.returncode not in (0, 1):  # 1: not all arrived
        raise ConfigError(f"the loop bench ended with status {done.returncode}")
    figures: dict[str, object] = json.loads(out.read_text())
    return figures


def drive_laps(model: Path, map_name: str, look: Look, drives: int) -> Driven:
    """Drives of two laps through motors, HAT and camera of a virtual robot."""
    road_map, ended = load_map(map_name), []
    for number in range(FIRST, FIRST + drives):
        lap_drive = LapDrive(road_map, look, open_policy(model), number)
        ended.append(lap_drive.drive(LAPS, lambda *_: None).laps)
        lap_drive.close()
    whole_laps = sum(min(max(int(laps), 0), int(LAPS)) for laps in ended)
    return Driven(whole_laps, int(LAPS) * drives, sum(laps >= LAPS for laps in ended))


def judged(options: argparse.Namespace, model: Path, look: Look, out: Path, asked: int) -> Driven:
    """Laps of a keeper, missions of a navigator; what is there already is not driven again."""
    if out.is_file() and "driven" in (told := json.loads(out.read_text())):
        return Driven(**told["driven"])
    if not OnnxPolicy(model).contract.path_points:
        driven = drive_laps(model, options.map, look, asked // int(LAPS))
    else:
        write_yaml(site := out.with_suffix(".yaml"), look)
        more = ("--model", str(model), "--missions", str(asked), "--seed", str(FIRST))
        figures = bench(options, site, out.with_suffix(".missions.json"), *more)
        arrived = int(str(figures["arrived"]))
        driven = Driven(arrived, asked, arrived)
    write_json(out, {"driven": asdict(driven)})
    return driven


def floor(options: argparse.Namespace, name: str, look: Look) -> Floor | None:
    """Record, teach and judge; without teaching where it is only to be recorded."""
    folder: Path = options.folder / name
    folder.mkdir(parents=True, exist_ok=True)
    write_yaml(site := folder / "look.yaml", look)
    base = base_file(options.base)
    by_hand = ("--driver", "expert", "--record", str(folder / "drives"))
    more = (*by_hand, "--missions", str(options.missions), "--seed", str(options.seed))
    recorded = bench(options, site, folder / "drives.json", *more)
    before = judged(options, base, look, folder / "before.json", options.judged)
    if options.record_only:
        return None
    model = folder / "taught" / "model.onnx"
    if not model.is_file() or OnnxPolicy(model).contract.proof is None:
        drives = tuple(sorted((folder / "drives").glob("*.mcap")))
        teach_command(drives, str(base), model.parent, seed=options.seed)
    proof = OnnxPolicy(model).contract.proof
    assert proof is not None
    return Floor(
        name,
        float(str(recorded["seconds"])),
        before,
        judged(options, model, look, folder / "after.json", options.judged),
        judged(options, model, NOMINAL, folder / "nominal.json", max(2, options.judged // 5)),
        round(100 * proof.succeeded / proof.drives),
        not OnnxPolicy(model).contract.unproven,
    )


def judge(options: argparse.Namespace) -> None:
    """Print each floor, and write them. ConfigError: FOLDER holds those of other options."""
    inputs = {name: getattr(options, name) for name in INPUTS}
    options.folder.mkdir(parents=True, exist_ok=True)
    kept: Path = options.folder / "inputs.json"
    if kept.is_file() and (before := json.loads(kept.read_text())) != inputs:
        raise ConfigError(f"{options.folder}: expected a new folder, or {before}, got {inputs}")
    write_json(kept, inputs)
    done = []
    for name, look in floors(0):
        if options.floors is not None and name not in options.floors:
            continue
        if told := floor(options, name, look):
            done.append(asdict(told))
            print(json.dumps(done[-1]), flush=True)
            if options.json:
                write_json(options.json, {"floors": done})


def main(arguments: list[str] | None = None) -> int:
    """Exit status 2 for wrong input."""
    parser = OneLineParser(prog="python -m tests.trainer.judge_teach_loop", description=__doc__)
    parser.add_argument("folder", type=Path, help="keeps recordings, policies and figures")
    parser.add_argument("--base", default="lane_dueling", help="an ONNX file or a shipped policy")
    parser.add_argument("--map", default="rings/claw", help="of a ring, or a town for navigators")
    parser.add_argument("--missions", type=whole(1, 1000), default=22, help="recorded by hand")
    parser.add_argument("--judged", type=whole(2, 1000), default=50, help="laps, or missions")
    names = [f"{site}_{camera}" for site in SITES for camera in CAMERAS]
    parser.add_argument("--floors", nargs="*", choices=names, help="all without")
    parser.add_argument("--record-only", action="store_true", help="record, and judge the base")
    parser.add_argument("--seed", type=whole(0, 2**31 - 1), default=0)
    parser.add_argument("--json", type=Path, help="write the figures")
    options = parser.parse_args(arguments)
    return answer("judge_teach_loop", lambda: judge(options))


if __name__ == "__main__":
    sys.exit(main())
