"""Programs around the robot and the trainer: demo, loop, faults, monitor, replay, data."""

from robot.command_line import tell_of_imports

tell_of_imports("tools")
