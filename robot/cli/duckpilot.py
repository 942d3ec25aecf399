"""``duckpilot``: every command of the project under one name.

It hands the words on to the program that ``python -m`` starts, too, imported when it is asked for.
With Python 3.8 it offers the robot's commands and the localizer's.
"""

import importlib
import sys
from importlib.util import find_spec
from typing import Dict, List, NamedTuple, Optional

from robot import cli
from robot.command_line import WRONG, answer, one_line
from robot.errors import nearest

NAME = "duckpilot"
NEWER = (3, 11)  # what trainer, simulator and tools are written in
TOOLS = {
    "demo": "train, export, judge and drive before your eyes, in minutes",
    "loop.__main__": "missions or laps through the whole system on virtual hardware",
    "faults.__main__": "meet every fault on virtual hardware, and see the robot stop",
    "monitor.__main__": "the operator's page in the browser",
    "replay": "decide a recorded drive again, and compare",
    "data.__main__": "list, plot, cut and split recorded drives; to and from Donkeycar and LeRobot",
}


class Program(NamedTuple):
    """Who does a command."""

    module: str  # has main(words, prog)
    purpose: str
    own: bool = True  # the command is the program; else its first word


def main(words: Optional[List[str]] = None) -> int:
    """Run one command; its exit status, 2 for a command that there is not."""
    words = sys.argv[1:] if words is None else words
    return answer(" ".join([NAME, *words[:1]]), lambda: _run(words))


def programs() -> Dict[str, Dict[str, Program]]:
    """The commands that this computer can run, in groups."""
    robot = {name: Program("robot.cli", told, False) for name, told in cli.COMMANDS.items()}
    eye = {"localizer": Program("localizer_node.__main__", "find the robots on the floor")}
    found = {"the robot": robot, "the overhead camera": eye}
    if sys.version_info < NEWER or find_spec("trainer") is None:
        return found
    trainer = importlib.import_module("trainer.cli")
    learn = {
        name: Program("trainer.cli", getattr(each, "purpose", trainer.PURPOSES.get(name)), False)
        for name, each in trainer.COMMANDS.items()
    }
    tools = {name.split(".")[0]: Program(f"tools.{name}", told) for name, told in TOOLS.items()}
    return {"learning": learn, "the whole system": tools, **found}


def _run(words: List[str]) -> Optional[int]:
    groups = programs()
    known = {name: each for group in groups.values() for name, each in group.items()}
    name = words[0] if words else ""
    if name in ("-h", "--help"):
        print(_help(groups))
        return 0
    if name not in known:
        got = f"unknown command {name[:80]!r}" if name else "expected a command, got none"
        said = f"{got}; {nearest(name, known)}"
        if len(groups) < 3:
            said += "; the others need Python 3.11 and pip install '.[trainer,monitor]'"
        print(f"{NAME}: {one_line(said)}; see {NAME} --help", file=sys.stderr)
        return WRONG
    program = known[name]
    run = importlib.import_module(program.module).main
    rest, prog = (words[1:], f"{NAME} {name}") if program.own else (words, NAME)
    status: Optional[int] = run(rest, prog=prog)
    return status


def _help(groups: Dict[str, Dict[str, Program]]) -> str:
    lines = [f"usage: {NAME} COMMAND …"]
    wide = 2 + max(len(name) for group in groups.values() for name in group)
    for title, group in groups.items():
        rows = (f"  {name:{wide}}{each.purpose}" for name, each in group.items())
        lines += ["", f"{title}:", *rows]
    return "\n".join([*lines, "", f"{NAME} COMMAND --help tells its options."])


if __name__ == "__main__":
    sys.exit(main())
