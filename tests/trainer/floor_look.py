"""``python -m tests.trainer.floor_look NAME OUT``: one of the floors of judge_teach, as a look.

For ``loop --look``, which drives, records and judges there through the real processes.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from robot.command_line import OneLineParser, answer
from robot.output import write_yaml
from tests.trainer.judge_teach import CAMERAS, SITES, floors


def write(options: argparse.Namespace) -> None:
    """As judge_teach draws it with this seed."""
    write_yaml(options.out, dict(floors(options.seed))[options.name])


def main(arguments: list[str] | None = None) -> int:
    """Exit status 2 for wrong input."""
    parser = OneLineParser(prog="python -m tests.trainer.floor_look", description=__doc__)
    names = [f"{site}_{camera}" for site in SITES for camera in CAMERAS]
    parser.add_argument("name", choices=names)
    parser.add_argument("out", type=Path, help="a YAML file")
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args(arguments)
    return answer("floor_look", lambda: write(options))


if __name__ == "__main__":
    sys.exit(main())
