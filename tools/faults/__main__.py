"""``python -m tools.faults``: every fault in the loop with the real processes; a table."""

import sys

from trainer.cli import Command, run

COMMAND = Command("tools.faults.cli:faults_command", "meet every fault on virtual hardware")
PROGRAM = "python -m tools.faults"


def main(arguments: list[str] | None = None, prog: str = PROGRAM) -> int:
    """Exit status 0 when the robot did right in every case, 2 for wrong input, 1 otherwise."""
    return run(COMMAND, arguments, prog)


if __name__ == "__main__":
    sys.exit(main())
