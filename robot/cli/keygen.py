"""Make the keys of robot, localizer and monitor: one folder for each machine.

Nothing is ever overwritten. Copy each folder to its machine, and delete the rest.
"""

import argparse
from pathlib import Path

from robot.link.keys import keygen


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The command's options."""
    parser.add_argument("directory", type=Path, metavar="DIR", help="where the folders are made")


def run(options: argparse.Namespace) -> None:
    """Do it; ConfigError where keys are there already, or the place cannot be written."""
    for machine, folder in keygen(options.directory).items():
        print(f"{folder}: copy it to the {machine}, as /etc/duckpilot/keys/{machine}")
    print("secret.key must stay readable by its owner alone (mode 600); delete the folders here")
