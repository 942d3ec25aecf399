"""The kinds of change to a computer. Each says what it does, and undoes what it did."""

from __future__ import annotations

import grp
import pwd
import subprocess
from dataclasses import dataclass
from pathlib import Path
from typing import Callable, List, Sequence, Tuple, Union

from robot.errors import HardwareError
from robot.output import write_bytes


class Host:
    """The computer that is installed on: its files below a root, its commands, users and groups."""

    root = Path("/")  # another one in tests

    def run(self, command: Sequence[str]) -> None:
        """Run a command; HardwareError when it fails."""
        try:
            done = subprocess.run(list(command), check=False)
        except OSError as error:
            raise HardwareError(f"{command[0]}: expected a program, got: {error}") from error
        if done.returncode != 0:
            raise HardwareError(f"{' '.join(command)}: ended with status {done.returncode}")

    def has_user(self, name: str) -> bool:
        """Whether there is such a user."""
        return any(user.pw_name == name for user in pwd.getpwall())

    def has_group(self, name: str) -> bool:
        """Whether there is such a group."""
        return any(group.gr_name == name for group in grp.getgrall())

    def members(self, group: str) -> List[str]:
        """The users that were added to a group."""
        return next((g.gr_mem for g in grp.getgrall() if g.gr_name == group), [])


KEPT = ".before-duckpilot"  # a file that was there before is kept under this ending
Command = Tuple[str, ...]


def at(host: Host, path: str) -> Path:
    """A path of the host, below its root."""
    return host.root / path.lstrip("/")


def run_all(host: Host, commands: Sequence[Command]) -> None:
    """Run them in order; HardwareError from the first that fails."""
    for command in commands:
        host.run(command)


def told(commands: Sequence[Command]) -> List[str]:
    """As a person would type them."""
    return [f"run: {' '.join(command)}" for command in commands]


@dataclass(frozen=True)
class WrittenFile:
    """A file with this content; ``after`` runs when it was written or removed.

    ``theirs`` marks a file that a person goes on to edit: it is only written where there is none,
    and kept when they have changed it.
    """

    path: str
    content: bytes
    after: Tuple[Command, ...] = ()
    theirs: bool = False

    @property
    def name(self) -> str:
        """The path."""
        return self.path

    def needed(self, host: Host) -> bool:
        """Whether the computer is not yet so."""
        path = at(host, self.path)
        return not path.is_file() or (not self.theirs and path.read_bytes() != self.content)

    def tell(self) -> List[str]:
        """The lines of a dry run: what exactly is written and run."""
        try:
            lines = [f"    {line}" for line in self.content.decode("utf-8").splitlines()]
        except UnicodeDecodeError:
            lines = [f"    ({len(self.content)} bytes)"]
        return [f"write {self.path}:", *lines, *told(self.after)]

    def do(self, host: Host) -> None:
        """Make it so."""
        path, kept = at(host, self.path), at(host, self.path + KEPT)
        if path.is_file() and not kept.exists():
            path.rename(kept)
        write_bytes(path, self.content)
        path.chmod(0o644)
        try:
            run_all(host, self.after)
        except HardwareError:
            self._put_back(host)  # else the next attempt would think that all is done
            raise

    def tell_undo(self) -> List[str]:
        """The lines of a dry run of undoing it."""
        but = ", unless it was edited" if self.theirs else ""
        return [f"remove {self.path}, or put back what was there{but}", *told(self.after)]

    def undo(self, host: Host) -> None:
        """Make it as it was before."""
        path = at(host, self.path)
        if self.theirs and path.is_file() and path.read_bytes() != self.content:
            return
        self._put_back(host)
        run_all(host, self.after)

    def _put_back(self, host: Host) -> None:
        path, kept = at(host, self.path), at(host, self.path + KEPT)
        if path.is_file():
            path.unlink()
        if kept.exists():
            kept.rename(path)


@dataclass(frozen=True)
class Commands:
    """Commands to run while ``needed``, and those that undo them."""

    name: str
    is_needed: Callable[[Host], bool]
    commands: Tuple[Command, ...]
    undoing: Tuple[Command, ...]

    def needed(self, host: Host) -> bool:
        """Whether the computer is not yet so."""
        return self.is_needed(host)

    def tell(self) -> List[str]:
        """The lines of a dry run: what exactly is written and run."""
        return told(self.commands)

    def do(self, host: Host) -> None:
        """Make it so."""
        run_all(host, self.commands)

    def tell_undo(self) -> List[str]:
        """The lines of a dry run of undoing it."""
        return told(self.undoing)

    def undo(self, host: Host) -> None:
        """Make it as it was before."""
        run_all(host, self.undoing)


Change = Union[WrittenFile, Commands]  # ``name`` identifies one in the manifest


def folder(path: str, owner: str = "root", mode: int = 0o755) -> Commands:
    """A folder; removed again only when nothing is in it."""
    make = ("install", "-d", "-m", f"{mode:o}", "-o", owner, "-g", owner, path)
    remove = ("rmdir", "--ignore-fail-on-non-empty", path)
    return Commands(path, lambda host: not at(host, path).is_dir(), (make,), (remove,))


def group(name: str) -> Commands:
    """A system group."""
    make = ("groupadd", "--system", name)
    label = f"group {name}"
    return Commands(label, lambda host: not host.has_group(name), (make,), (("groupdel", name),))


def user(name: str, home: str) -> Commands:
    """A system user that nobody can log in as, with a group of the same name."""
    shell = ("--shell", "/usr/sbin/nologin")
    make = ("useradd", "--system", "--user-group", "--home-dir", home, *shell, name)
    label = f"user {name}"
    return Commands(label, lambda host: not host.has_user(name), (make,), (("userdel", name),))


def membership(member: str, of: str) -> Commands:
    """A user in a group."""
    add, delete = ("gpasswd", "--add", member, of), ("gpasswd", "--delete", member, of)
    label = f"{member} in {of}"
    return Commands(label, lambda host: member not in host.members(of), (add,), (delete,))


def enabled(unit: str) -> Commands:
    """A service that starts with the computer; it is not started now."""
    link = f"/etc/systemd/system/multi-user.target.wants/{unit}"

    def is_needed(host: Host) -> bool:
        return not (at(host, link).exists() or at(host, link).is_symlink())

    disable = ("systemctl", "disable", "--now", unit)
    return Commands(f"enabled {unit}", is_needed, (("systemctl", "enable", unit),), (disable,))
