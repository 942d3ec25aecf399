"""``python -m tools.loop``: missions with all programs as processes, or laps in one process."""

from __future__ import annotations

import sys

from robot.command_line import answer, spoken
from tools.loop.options import PROGRAM, parse_laps, parse_missions


def main(arguments: list[str] | None = None, prog: str = PROGRAM) -> int:
    """``--laps`` asks for one robot's laps; else all programs are started and drive missions.

    Exit status 0 when all of it was driven, 2 for wrong input, 1 otherwise.
    """
    words = sys.argv[1:] if arguments is None else arguments
    laps = any(len(w) > 3 and "--laps".startswith(w.split("=")[0]) for w in words)
    options = (parse_laps if laps else parse_missions)(words, prog)

    def work() -> int:
        if laps:
            from tools.loop.laps import tell

            return tell(options)
        from tools.loop.drive import drive

        return drive(options)

    return answer(spoken(prog), work)


if __name__ == "__main__":
    sys.exit(main())
