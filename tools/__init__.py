"""Programs around the robot and the trainer: demo, bench, loop, monitor."""

from robot.command_line import tell_of_imports

tell_of_imports("tools")
