"""``python -m tools.monitor``: the operator's page."""

import sys
from functools import partial

from trainer.cli import Command, run

COMMAND = Command("tools.monitor.cli:monitor_command", "the operator's page in the browser")
main = partial(run, COMMAND, prog="python -m tools.monitor")


if __name__ == "__main__":
    sys.exit(main())
