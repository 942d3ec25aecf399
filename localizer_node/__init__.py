"""The overhead camera: finds the robots on the floor and says where they are."""

from robot.command_line import tell_of_imports

tell_of_imports("localizer_node")
