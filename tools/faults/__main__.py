"""``python -m tools.faults``: every fault in the loop with the real processes; a table."""

import sys
from functools import partial

from trainer.cli import Command, run

main = partial(run, Command("tools.faults.cli:faults_command"), prog="python -m tools.faults")


if __name__ == "__main__":
    sys.exit(main())
