"""Programs around the robot and the trainer: demo, bench, loop, monitor."""
