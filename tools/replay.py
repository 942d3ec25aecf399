"""``python -m tools.replay RECORDING``: decides a recorded drive again and compares.

Exit status 0: every action came out as it was. 1: some did not; they are listed. 2: a file in which
there is nothing to decide again, and why.
"""

import argparse
import sys
from pathlib import Path

from robot.command_line import OneLineParser, answer, spoken
from robot.errors import ContractError
from robot.inference.policy import OnnxPolicy
from robot.recording.replay import replay

SHOWN = 20
PROGRAM = "python -m tools.replay"


def main(arguments: list[str] | None = None, prog: str = PROGRAM) -> int:
    """0: nothing differs; 1: something does; 2: wrong input, or nothing was decided in it."""
    parser = OneLineParser(prog=prog, description=__doc__)
    parser.add_argument("recording", type=Path, help="an .mcap file of the robot's")
    parser.add_argument("--model", type=Path, help="another policy: what would it have done?")
    options = parser.parse_args(arguments)
    return answer(spoken(prog), lambda: decide_again(options))


def decide_again(options: argparse.Namespace) -> int:
    """0: nothing differs; 1: something does; ContractError: nothing was decided in it."""
    found = replay(options.recording, OnnxPolicy(options.model) if options.model else None)
    if not found.decisions:
        raise ContractError(
            f"{options.recording}: expected the robot's own recording of a drive by its policy, "
            f"found no decision in its {found.turns} turns"
        )
    for difference in found.differences[:SHOWN]:
        print(f"turn {difference.number} at {difference.time_s:.2f} s: {difference.sentence}")
    if len(found.differences) > SHOWN:
        print(f"… and {len(found.differences) - SHOWN} more")
    how = "bit for bit" if found.exact else f"values within {found.worst:.1e}"
    close = f", {found.close} too close to call" if found.close else ""
    print(
        f"{options.recording.name}: {found.decisions} decisions of {found.turns} turns replayed "
        f"({how}), {len(found.differences)} differ{close}"
    )
    return 1 if found.differences else 0


if __name__ == "__main__":
    sys.exit(main())
