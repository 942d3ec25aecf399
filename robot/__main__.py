"""``python -m robot``: the robot's commands."""

from __future__ import annotations

import sys

from robot.cli import main

if __name__ == "__main__":
    sys.exit(main())
