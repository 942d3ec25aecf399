"""The offline trainer: networks, algorithms, evaluation, export and reports."""

from robot.command_line import tell_of_imports

tell_of_imports("trainer")
