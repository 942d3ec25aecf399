"""``python -m robot``: the robot's commands."""

import sys

from robot.cli import main

if __name__ == "__main__":
    sys.exit(main())
