"""Programs around the robot and the trainer: demo, loop, faults, monitor, replay, data."""
