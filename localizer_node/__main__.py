"""``python -m localizer_node {run,calibrate,locate}``."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import Optional, Sequence

from localizer_node import calibrate_command, commands
from robot.command_line import OneLineParser, answer, spoken, whole


def main(argv: Optional[Sequence[str]] = None, prog: str = "python -m localizer_node") -> int:
    """Run one command; 0 done, 2 wrong input, 130 Ctrl-C, 1 a device that does not answer."""
    arguments = _parser(prog).parse_args(argv)
    return answer(spoken(prog), lambda: arguments.command(arguments))


def _parser(prog: str) -> argparse.ArgumentParser:
    parser = OneLineParser(prog=prog, description=__doc__)
    actions = parser.add_subparsers(required=True, metavar="COMMAND")
    run = actions.add_parser("run", help="follow the robots and publish their poses")
    run.add_argument("--calibration", required=True)
    run.add_argument(
        "--source",
        default="0",
        help="camera number, csi, socket:PATH, video, or picture folder",
    )
    run.add_argument("--fps", type=whole(1, 240), default=30)
    run.add_argument("--link", help="YAML of the link; without it poses are printed as JSON lines")
    run.set_defaults(command=commands.run)
    locate = actions.add_parser("locate", help="find the robots in one picture")
    locate.add_argument("--image", type=Path, required=True)
    locate.add_argument("--calibration", type=Path, required=True)
    locate.add_argument(
        "--json", nargs="?", const=commands.STDOUT, metavar="OUT", help="JSON to OUT or stdout"
    )
    locate.add_argument("--picture", type=Path, metavar="PNG", help="draw what was found")
    locate.set_defaults(command=commands.locate)
    calibrate = actions.add_parser("calibrate", help="make the calibration of an arena")
    calibrate_command.add_arguments(calibrate)
    return parser


if __name__ == "__main__":
    sys.exit(main())
