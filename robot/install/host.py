"""The computer that is installed on: its files below a root, its commands, users and groups."""

from __future__ import annotations

import grp
import pwd
import subprocess
from pathlib import Path
from typing import List, Protocol, Sequence

from robot.errors import HardwareError


class Host(Protocol):
    """What a change asks of the computer."""

    @property
    def root(self) -> Path:
        """Where its files are; ``/`` but in tests."""

    def run(self, command: Sequence[str]) -> None:
        """Run a command; HardwareError when it fails."""

    def has_user(self, name: str) -> bool:
        """Whether there is such a user."""

    def has_group(self, name: str) -> bool:
        """Whether there is such a group."""

    def members(self, group: str) -> List[str]:
        """The users that were added to a group."""


class ThisHost:
    """The computer that this program runs on."""

    root = Path("/")

    def run(self, command: Sequence[str]) -> None:
        """See ``Host``."""
        try:
            done = subprocess.run(list(command), check=False)
        except OSError as error:
            raise HardwareError(f"{command[0]}: expected a program, got: {error}") from error
        if done.returncode != 0:
            raise HardwareError(f"{' '.join(command)}: ended with status {done.returncode}")

    def has_user(self, name: str) -> bool:
        """See ``Host``."""
        return any(user.pw_name == name for user in pwd.getpwall())

    def has_group(self, name: str) -> bool:
        """See ``Host``."""
        return any(group.gr_name == name for group in grp.getgrall())

    def members(self, group: str) -> List[str]:
        """See ``Host``."""
        return next((g.gr_mem for g in grp.getgrall() if g.gr_name == group), [])
