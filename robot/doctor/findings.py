"""What a check found."""

from __future__ import annotations

from enum import Enum
from typing import NamedTuple


class Level(Enum):
    """How bad it is."""

    OK = "OK"
    WARN = "WARN"  # the robot drives, but a person should know
    FAIL = "FAIL"  # the robot cannot drive so


class Finding(NamedTuple):
    """One line of the report: what was looked at, what it is, and what to do."""

    name: str
    level: Level
    says: str
    remedy: str = ""

    @property
    def line(self) -> str:
        """For a person."""
        text = f"{self.level.value:4s}  {self.name:14s}{self.says}"
        return f"{text}\n{'':20s}-> {self.remedy}" if self.remedy else text


def ok(name: str, says: str) -> Finding:
    """All is well."""
    return Finding(name, Level.OK, says)


def warn(name: str, says: str, remedy: str) -> Finding:
    """The robot drives, but a person should know."""
    return Finding(name, Level.WARN, says, remedy)


def fail(name: str, says: str, remedy: str) -> Finding:
    """The robot cannot drive so."""
    return Finding(name, Level.FAIL, says, remedy)
