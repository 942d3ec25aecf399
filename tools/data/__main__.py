"""``python -m tools.data``: recorded drives, and what others learn from.

Whatever it writes appears whole or not at all; what it reads stays as it is.
"""

import sys
from functools import partial

from trainer.cli import Command, run

_DO = "tools.data.cli"
COMMANDS = {
    "list": Command(f"{_DO}:list_command", "who drove how long, take-overs, marks"),
    "plot": Command(f"{_DO}:plot_command", "steering and speed over time"),
    "split": Command(f"{_DO}:split_command", "whole drives to learn from, others to judge by"),
    "cut": Command(f"{_DO}:cut_command", "keep what is marked good, drop what is marked bad"),
    "to-donkeycar": Command(f"{_DO}:to_donkeycar_command", "as a Donkeycar tub (version 2)"),
    "to-lerobot": Command(f"{_DO}:to_lerobot_command", "as a LeRobot dataset (version 3.0)"),
    "from-donkeycar": Command(f"{_DO}:from_donkeycar_command", "a Donkeycar tub as recordings"),
    "from-lerobot": Command(f"{_DO}:from_lerobot_command", "a LeRobot dataset as recordings"),
}
main = partial(run, COMMANDS, prog="python -m tools.data")


if __name__ == "__main__":
    sys.exit(main())
