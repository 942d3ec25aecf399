"""``python -m tools.loop``: missions with all programs as processes, or laps in one process."""

import sys
from functools import partial

from trainer.cli import Command, run

COMMAND = Command("tools.loop.cli:loop_command", "drive missions or laps on virtual hardware")
main = partial(run, COMMAND, prog="python -m tools.loop")


if __name__ == "__main__":
    sys.exit(main())
