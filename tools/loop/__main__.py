"""``python -m tools.loop``: laps in one process, or missions with all programs as processes."""

from __future__ import annotations

import sys


def main(arguments: list[str]) -> int:
    """``--missions`` asks for the bench with all programs; without it one robot drives laps."""
    if any(word.split("=")[0] == "--missions" for word in arguments):
        from tools.loop import drive

        return drive.main(arguments)
    from tools.loop import laps

    return laps.main(arguments)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
