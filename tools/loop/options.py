"""What the loop bench can be asked for: to read it takes none of what it needs."""

from __future__ import annotations

import argparse
import math
import shutil
import sys
from pathlib import Path

from robot.command_line import SEED, OneLineParser, number, whole
from robot.inference.policy_file import SHIPPED_MODELS

NAVIGATOR = SHIPPED_MODELS / "nav_dueling.onnx"
LANE_KEEPER = SHIPPED_MODELS / "lane_dueling.onnx"
PROGRAM = "python -m tools.loop"
MISSIONS = """The whole system drives missions on the bench.

A world process holds town, wheels, HAT and cameras; robot, localizer and monitor are the programs
as they are, over encrypted links; missions are clicked, in effect, on the monitor's page.
"""
LAPS = """The runtime drives laps through virtual hardware, in lock-step.

Town, motors and camera are virtual; everything between the camera's frame and the bus's bytes is
the robot's own code. Time is simulated, so the drive is the same on every machine.
"""


def parse_missions(arguments: list[str] | None, prog: str = PROGRAM) -> argparse.Namespace:
    """The command line of missions."""
    parser = OneLineParser(prog=prog, description=MISSIONS)
    add = parser.add_argument
    add("--map", default="arena", help="map file, or the name of a shipped one")
    add("--model", type=Path, default=NAVIGATOR, help="ONNX policy for navigation")
    add("--missions", type=whole(1, 100_000), default=1, help="how many, each to a random place")
    add("--start", type=place, metavar="X,Y", help="where the first begins [m]; else anywhere")
    add("--goal", type=place, metavar="X,Y", help="where the only mission leads [m]")
    add("--look", default="nominal", help="YAML file, a folder of them, or a shipped name")
    add("--seed", type=SEED, default=0)
    add("--realtime", action="store_true", help="by the wall clock, not in step")
    add("--robot-python", default=sys.executable, help="runs the robot's process")
    add("--video", type=Path, help="write a film of the drive, an MP4")
    add("--json", type=Path, help="write the figures; goes on with what is there")
    laps = parser.add_argument_group(
        "laps instead of missions",
        "one robot alone, in one process and in lock-step; also takes --map, --model (a policy for "
        "lane keeping), --look, --seed, --video and --json",
    )
    laps.add_argument("--laps", metavar="N", help="drive so many laps of a ring of road")
    laps.add_argument("--translator", help="ONNX translator, real-to-sim, before the policy")
    options = parser.parse_args(arguments)
    if options.laps or options.translator:
        parser.error("--translator: expected --laps N, too: missions are driven without one")
    if options.goal is not None and options.missions > 1:
        parser.error(f"--goal: expected one mission, got --missions {options.missions}")
    if shutil.which(options.robot_python) is None:
        parser.error(f"--robot-python: expected a Python to start, got {options.robot_python}")
    return options


def place(text: str) -> tuple[float, float]:
    """``X,Y`` in metres."""
    try:
        x_m, y_m = (float(word) for word in text.split(","))
    except ValueError:
        x_m = y_m = math.nan
    if not math.isfinite(x_m + y_m):
        raise argparse.ArgumentTypeError(f"expected X,Y in metres, got {text!r}; e.g. 1.2,0.4")
    return x_m, y_m


def parse_laps(arguments: list[str] | None, prog: str = PROGRAM) -> argparse.Namespace:
    """The command line of laps."""
    parser = OneLineParser(prog=f"{prog} --laps N", description=LAPS)
    parser.add_argument("--map", default="loop", help="map file, or the name of a shipped one")
    parser.add_argument("--model", type=Path, default=LANE_KEEPER, help="policy for lane keeping")
    parser.add_argument("--translator", default="", help="ONNX translator, real-to-sim")
    parser.add_argument("--laps", type=number(0.01, 10_000), required=True, help="how many")
    parser.add_argument(
        "--look", default="nominal", help="YAML file, a folder of them, or a shipped name"
    )
    parser.add_argument("--seed", type=SEED, default=0)
    parser.add_argument("--video", type=Path, help="write a film of the drive, an MP4")
    parser.add_argument("--json", type=Path, help="write the figures")
    return parser.parse_args(arguments)
