"""``python -m tools.faults``: every fault in the loop with the real processes; a table.

In lock-step: times are those of the robot's own clock, without what a slow computer adds.
"""

import argparse
import sys
from pathlib import Path

from robot.command_line import SEED, OneLineParser, answer, spoken
from tools.faults.case import FAMILIES

PROGRAM = "python -m tools.faults"


def parse(arguments: list[str] | None, prog: str = PROGRAM) -> argparse.Namespace:
    """The command line."""
    parser = OneLineParser(prog=prog, description=__doc__)
    parser.add_argument("--model", type=Path, required=True, help="ONNX policy for navigation")
    parser.add_argument(
        "--sight", type=Path, help="ONNX; while it drives, it alone tells the place"
    )
    parser.add_argument("--family", action="append", choices=FAMILIES, help="only these")
    parser.add_argument("--case", action="append", help="only these, by name")
    parser.add_argument("--seed", type=SEED, default=0)
    parser.add_argument("--json", type=Path, help="write the outcomes; goes on from there")
    parser.add_argument("--report", type=Path, help="write the table, such as docs/faults.md")
    return parser.parse_args(arguments)


def main(arguments: list[str] | None = None, prog: str = PROGRAM) -> int:
    """Exit status 0 when the robot did right in every case, 2 for wrong input, 1 otherwise."""
    options = parse(arguments, prog)

    def work() -> int:
        from tools.faults.meet import meet

        return meet(options)

    return answer(spoken(prog), work)


if __name__ == "__main__":
    sys.exit(main())
