"""``python -m tools.loop``: missions with all programs as processes, or laps in one process."""

import sys
from functools import partial

from trainer.cli import Command, run

main = partial(run, Command("tools.loop.cli:loop_command"), prog="python -m tools.loop")


if __name__ == "__main__":
    sys.exit(main())
