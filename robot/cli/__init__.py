"""The robot's command line: one module for each command.

A module has ``HELP``, ``add_arguments(parser)`` and ``run(options)``. Exit status 0: done; 2: wrong
input, told in one line; 1: anything else.
"""

from __future__ import annotations

import argparse
import importlib
import sys
from typing import List, NoReturn, Optional

from robot.errors import DuckpilotError, HardwareError

COMMANDS = {
    "drive": "robot.cli.drive",
    "infer": "robot.cli.infer",
    "bench": "robot.cli.bench",
}


class OneLineParser(argparse.ArgumentParser):
    """Tells what is wrong in one line, without the usage before it."""

    def error(self, message: str) -> NoReturn:
        """Exit with status 2."""
        self.exit(2, f"{self.prog}: {message}; see {self.prog} --help\n")


def main(arguments: Optional[List[str]] = None) -> int:
    """Run one command; returns its exit status."""
    options = make_parser().parse_args(arguments)
    try:
        options.run(options)
    except DuckpilotError as error:
        print(f"robot {options.command}: {error}", file=sys.stderr)
        return 2
    except HardwareError as error:
        print(f"robot {options.command}: {error}", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        return 130
    return 0


def make_parser() -> argparse.ArgumentParser:
    """The parser of all commands."""
    parser = OneLineParser(prog="python -m robot", description="The robot's commands.")
    commands = parser.add_subparsers(dest="command", required=True, metavar="COMMAND")
    for name, module_name in COMMANDS.items():
        module = importlib.import_module(module_name)
        command = commands.add_parser(name, help=module.HELP, description=module.__doc__)
        module.add_arguments(command)
        command.set_defaults(run=module.run)
    return parser
