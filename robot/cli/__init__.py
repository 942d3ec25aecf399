"""The robot's command line: one module for each command.

A module has ``add_arguments(parser)`` and ``run(options)``, and is imported only when it is asked
for: switching the motors off must not wait for numpy. Exit status 0: done; 2: wrong input, told in
one line; 130: Ctrl-C; 1: anything else.
"""

import importlib
import sys
from typing import List, Optional

from robot.command_line import OneLineParser, answer, spoken

COMMANDS = {
    "drive": "drive by camera and policy, as the configuration says",
    "infer": "run a policy over pictures",
    "bench": "measure decisions, memory and the loop's punctuality",
    "doctor": "look at everything the robot needs, and say what to do",
    "selftest": "test the motors, guided, with the wheels off the floor",
    "calibrate": "measure wheels, camera and lens, and write the configuration",
    "off": "switch every output of the motor HAT off",
    "keygen": "make the keys of robot, localizer and monitor",
    "install": "make this computer the robot's: environment, user, permissions, service",
}


def main(arguments: Optional[List[str]] = None, prog: str = "python -m robot") -> int:
    """Run one command of ``prog``; returns its exit status."""
    words = sys.argv[1:] if arguments is None else arguments
    asked = words[0] if words[:1] and words[0] in COMMANDS else ""

    def work() -> Optional[int]:
        parser = OneLineParser(prog=prog, description="The robot's commands.")
        commands = parser.add_subparsers(dest="command", required=True, metavar="COMMAND")
        for name, purpose in COMMANDS.items():
            command = commands.add_parser(name, help=purpose)
            if name == asked:
                module = importlib.import_module(f"robot.cli.{name}")
                command.description = module.__doc__
                module.add_arguments(command)
                command.set_defaults(run=module.run)
        options = parser.parse_args(words)
        status: Optional[int] = options.run(options)
        return status

    return answer(f"{spoken(prog)} {asked}".strip(), work)
