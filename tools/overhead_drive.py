"""How well the localizer does: robots that wander over the drawn arena under its camera.

``python -m tools.overhead_drive --kind tag --frames 10000`` hangs a new camera every 200 frames, in
random light, calibrates it from clicks, and follows three robots among blue clutter.
"""

from __future__ import annotations

import sys
from pathlib import Path

from robot.command_line import SEED, OneLineParser, answer, whole

KINDS = ("plain", "tag", "two_colour")


def main(arguments: list[str] | None = None) -> int:
    """Drive, and print or write the figures."""
    parser = OneLineParser(prog="python -m tools.overhead_drive", description=__doc__)
    parser.add_argument("--kind", choices=KINDS, default="two_colour")
    parser.add_argument("--frames", type=whole(1, 10_000_000), default=1000)
    parser.add_argument("--seed", type=SEED, default=0)
    parser.add_argument("--json", type=Path, metavar="OUT", help="write the figures there")
    options = parser.parse_args(arguments)

    def work() -> None:
        from tools.overhead_arena import measure

        measure(options)

    return answer("overhead_drive", work)


if __name__ == "__main__":
    sys.exit(main())
