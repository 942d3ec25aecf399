"""``python -m tools.loop``: missions with all programs as processes, or laps in one process."""

from __future__ import annotations

import sys


def main(arguments: list[str]) -> int:
    """``--laps`` asks for one robot's laps; else all programs are started and drive missions."""
    if any(len(w) > 3 and "--laps".startswith(w.split("=")[0]) for w in arguments):
        from tools.loop import laps

        return laps.main(arguments)
    from tools.loop import drive

    return drive.main(arguments)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
