"""``python -m tools.loop``: missions with all programs as processes, or laps in one process.

To read the command line takes none of what they need.
"""

import argparse
import shutil
import sys
from pathlib import Path

from robot.command_line import SEED, OneLineParser, answer, number, pair, spoken, whole
from robot.inference.policy import SHIPPED_MODELS

NAVIGATOR = SHIPPED_MODELS / "nav_dueling.onnx"
LANE_KEEPER = SHIPPED_MODELS / "lane_dueling.onnx"
PROGRAM = "python -m tools.loop"
DESCRIPTION = """The whole system drives missions on the bench.

A world process holds town, wheels, HAT and cameras; robot, localizer and monitor are the programs
as they are, over encrypted links; missions are clicked, in effect, on the monitor's page.
"""
place = pair("X,Y in metres, such as 1.2,0.4")
OF_MISSIONS = ("missions", "start", "goal", "sight", "driver", "record", "realtime", "robot_python")


def parse(arguments: list[str] | None, prog: str = PROGRAM) -> argparse.Namespace:
    """The command line; ``laps`` is None where missions are asked for."""
    parser = OneLineParser(prog=prog, description=DESCRIPTION)
    add = parser.add_argument
    add("--map", help="map file, or the name of a shipped one (default: arena; of laps loop)")
    add("--model", type=Path, help="ONNX policy for navigation, of laps for lane keeping")
    add("--look", default="nominal", help="YAML file, a folder of them, or a shipped name")
    add("--seed", type=SEED, default=0)
    add("--video", type=Path, help="write a film of the drive, an MP4")
    add("--json", type=Path, help="write the figures; missions go on with what is there")
    add = parser.add_argument_group("missions").add_argument
    add("--missions", type=whole(1, 100_000), default=1, help="how many, each to a random place")
    add("--start", type=place, metavar="X,Y", help="where the first begins [m]; else anywhere")
    add("--goal", type=place, metavar="X,Y", help="where the only mission leads [m]")
    add("--sight", type=Path, help="ONNX; it alone tells the place, without a localizer")
    add(
        "--driver",
        choices=("policy", "expert", "person"),
        default="policy",
        help="expert: by hand all the way; person: takes over where the policy strays",
    )
    add("--record", type=Path, metavar="FOLDER", help="keep the robot's recordings of the drives")
    add("--realtime", action="store_true", help="by the wall clock, not in step")
    add("--robot-python", default=sys.executable, help="runs the robot's process")
    add = parser.add_argument_group(
        "laps instead of missions", "one robot alone, in one process and in lock-step"
    ).add_argument
    add("--laps", type=number(0.01, 10_000), help="drive so many laps of a ring of road")
    add("--translator", help="ONNX translator, real-to-sim, before the policy")
    options = parser.parse_args(arguments)
    laps = options.laps is not None
    for name in OF_MISSIONS if laps else ("translator",):
        if getattr(options, name) != parser.get_default(name):
            flag = f"--{name.replace('_', '-')}"
            parser.error(f"{flag}: expected it {'without' if laps else 'with'} --laps")
    if options.goal is not None and options.missions > 1:
        parser.error(f"--goal: expected one mission, got --missions {options.missions}")
    if shutil.which(options.robot_python) is None:
        parser.error(f"--robot-python: expected a Python to start, got {options.robot_python}")
    options.map = options.map or ("loop" if laps else "arena")
    options.model = options.model or (LANE_KEEPER if laps else NAVIGATOR)
    return options


def main(arguments: list[str] | None = None, prog: str = PROGRAM) -> int:
    """Exit status 0 when all of it was driven, 2 for wrong input, 1 otherwise."""
    options = parse(arguments, prog)

    def work() -> int:
        if options.laps is not None:
            from tools.loop.laps import tell

            return tell(options)
        from tools.loop.drive import drive

        return drive(options)

    return answer(spoken(prog), work)


if __name__ == "__main__":
    sys.exit(main())
