"""``python -m tools.loop``: missions with all programs as processes, or laps in one process."""

from __future__ import annotations

import sys

from robot.command_line import answer, spoken
from tools.loop.options import PROGRAM, parse


def main(arguments: list[str] | None = None, prog: str = PROGRAM) -> int:
    """Exit status 0 when all of it was driven, 2 for wrong input, 1 otherwise."""
    options = parse(arguments, prog)

    def work() -> int:
        if options.laps is not None:
            from tools.loop.laps import tell

            return tell(options)
        from tools.loop.drive import drive

        return drive(options)

    return answer(spoken(prog), work)


if __name__ == "__main__":
    sys.exit(main())
