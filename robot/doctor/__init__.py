"""What is right and wrong with this computer as a robot, and what to do about it."""

from __future__ import annotations

from typing import NamedTuple

OK = "OK"
WARN = "WARN"  # the robot drives, but a person should know
FAIL = "FAIL"  # the robot cannot drive so


class Finding(NamedTuple):
    """One line of the report: what was looked at, how bad it is, what it is, and what to do."""

    name: str
    level: str
    says: str
    remedy: str = ""

    @property
    def line(self) -> str:
        """For a person."""
        text = f"{self.level:4s}  {self.name:14s}{self.says}"
        return f"{text}\n{'':20s}-> {self.remedy}" if self.remedy else text


def refused(name: str, error: Exception, remedy: str) -> Finding:
    """A failure as an error tells it: what it is, and behind the semicolon what to do."""
    says, _, told = str(error).partition("; ")
    return Finding(name, FAIL, says, told or remedy)
