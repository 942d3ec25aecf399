"""``python -m tools.data``: recorded drives, and what others learn from.

Whatever it writes appears whole or not at all; what it reads stays as it is.
"""

import argparse
import sys
from pathlib import Path

from robot.command_line import SEED, OneLineParser, answer, number, spoken
from robot.output import expect_writable, write_json

PROGRAM = "python -m tools.data"
FOLDER = "a new folder"


def parse(arguments: list[str] | None, prog: str = PROGRAM) -> argparse.Namespace:
    """The command line."""
    parser = OneLineParser(prog=prog, description=__doc__)
    commands = parser.add_subparsers(dest="command", required=True, metavar="COMMAND")

    def command(name: str, told: str, out: str, many: bool = True) -> argparse.ArgumentParser:
        one: argparse.ArgumentParser = commands.add_parser(name, help=told, description=told)
        given = "recordings, or folders of them" if many else "what to read"
        one.add_argument("source", type=Path, nargs="+" if many else None, help=given)
        if out:
            one.add_argument("--out", type=Path, required=True, help=out)
        return one

    command("list", "what is in recordings: who drove how long, take-overs, marks", "")
    command("plot", "steering and speed over time", "the picture")
    split = command(
        "split", "whole drives to learn from, and others to judge by", "JSON: learn and held_out"
    )
    split.add_argument("--held-out", type=number(0.01, 0.99), default=0.2, help="share to judge by")
    split.add_argument("--seed", type=SEED, default=0)
    command("cut", "keep what is marked good, drop what is marked bad", "the new recording", False)
    command("to-donkeycar", "recordings as a Donkeycar tub (version 2)", FOLDER)
    needs = "needs the extra lerobot"
    dataset = command(
        "to-lerobot", f"recordings as a LeRobot dataset (version 3.0); {needs}", FOLDER
    )
    dataset.add_argument("--task", default="drive along the lane", help="what it is, in words")
    command("from-donkeycar", "a Donkeycar tub as recordings", FOLDER, False)
    told = f"a LeRobot dataset of two wheels as recordings; {needs}"
    command("from-lerobot", told, FOLDER, False)
    return parser.parse_args(arguments)


def main(arguments: list[str] | None = None, prog: str = PROGRAM) -> int:
    """Exit status 2 for wrong input."""
    options = parse(arguments, prog)
    return answer(spoken(prog), lambda: work(options))


def work(options: argparse.Namespace) -> None:
    """Do what was asked for, and say what came of it."""
    if options.command == "cut":
        from robot.recording.reader import cut

        expect_writable(options.out, inputs=[options.source])
        print(f"{options.out}: {cut(options.source, options.out)} messages")
        return
    from tools.data import drives, lerobot

    if options.command.startswith("from-"):
        read = drives.from_tub if options.command == "from-donkeycar" else lerobot.from_dataset
        print(f"{options.out}: {len(read(options.source, options.out))} drives")
        return
    found = drives.drives_in(options.source)
    if options.command in ("plot", "split"):
        expect_writable(options.out, inputs=found)
    if options.command == "list":
        print(drives.table([drives.tell(path) for path in found]))
    elif options.command == "plot":
        drives.plot(found, options.out)
    elif options.command == "split":
        parts = drives.divide(found, options.held_out, options.seed)
        write_json(options.out, parts)
        print(", ".join(f"{name} {len(paths)} drives" for name, paths in parts.items()))
    elif options.command == "to-donkeycar":
        print(f"{options.out}: {drives.to_tub(found, options.out)} records")
    else:
        count = lerobot.to_dataset(found, options.out, options.task)
        print(f"{options.out}: {count} episodes")


if __name__ == "__main__":
    sys.exit(main())
