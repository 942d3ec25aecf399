"""Whether the robot may move, and how fast."""
