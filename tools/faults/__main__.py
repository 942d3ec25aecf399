"""``python -m tools.faults``: every fault in the loop with the real processes; a table."""

import sys
from functools import partial

from trainer.cli import Command, run

COMMAND = Command("tools.faults.cli:faults_command", "meet every fault on virtual hardware")
main = partial(run, COMMAND, prog="python -m tools.faults")


if __name__ == "__main__":
    sys.exit(main())
