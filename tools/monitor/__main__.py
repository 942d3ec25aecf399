"""``python -m tools.monitor``: the operator's page."""

import sys
from functools import partial

from trainer.cli import Command, run

main = partial(run, Command("tools.monitor.cli:monitor_command"), prog="python -m tools.monitor")


if __name__ == "__main__":
    sys.exit(main())
