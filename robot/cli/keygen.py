"""Make the keys of robot, localizer and monitor: one folder for each machine.

Nothing is ever overwritten. Copy each folder to its machine, and delete the rest.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import List

from robot.link.keys import ROLES, SECRET, keygen, renew


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The command's options."""
    parser.add_argument("directory", type=Path, metavar="DIR", help="where the folders are made")
    parser.add_argument(
        "--renew",
        action="store_true",
        help="DIR holds keys of an older version: write their roles into them, change nothing else",
    )


def run(options: argparse.Namespace) -> None:
    """Do it; ConfigError where keys are there already, or the place cannot be written."""
    if options.renew:
        for folder in _machines_in(options.directory):
            print(f"{folder}: keys of the {renew(folder)}, with their roles")
        return
    folders = keygen(options.directory)
    for machine in ROLES:
        print(f"{folders[machine]}: copy it to the {machine}, as /etc/duckpilot/keys/{machine}")
    print(
        "secret.key must stay readable by its owner alone (mode 600); then delete the folders here"
    )


def _machines_in(directory: Path) -> List[Path]:
    """The folder of one machine, or those of several in it."""
    inside = [directory / role for role in ROLES if (directory / role / SECRET).exists()]
    return inside or [directory]
