"""``python -m tools.loop``: missions with all programs as processes, or laps in one process."""

import sys

from trainer.cli import Command, run

COMMAND = Command("tools.loop.cli:loop_command", "drive missions or laps on virtual hardware")
PROGRAM = "python -m tools.loop"


def main(arguments: list[str] | None = None, prog: str = PROGRAM) -> int:
    """Exit status 0 when all of it was driven, 2 for wrong input, 1 otherwise."""
    return run(COMMAND, arguments, prog)


if __name__ == "__main__":
    sys.exit(main())
