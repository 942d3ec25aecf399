"""Opening the configured bus, for one program at a time.

Two programs that drive one HAT would take turns at its coils. So whoever drives holds the bus by
``flock``, which the kernel gives back whatever ends the program. Looking (``robot doctor``) and
switching off (``robot off``) need not own it.
"""

from __future__ import annotations

import fcntl
import os
from contextlib import ExitStack, contextmanager
from typing import Iterator, Union

from robot.errors import HardwareError
from robot.hat.bus import SmbusBus
from robot.hat.config import HatConfig
from robot.hat.socket_bus import SocketBus


def open_bus(config: HatConfig) -> Union[SmbusBus, SocketBus]:
    """The configured I2C bus.

    Raises:
        HardwareError: there is no such bus, or this user may not use it.
    """
    return SocketBus(config.socket) if config.socket else SmbusBus(config.bus)


@contextmanager
def own_bus(config: HatConfig) -> Iterator[Union[SmbusBus, SocketBus]]:
    """The configured I2C bus, for nobody else meanwhile.

    Raises:
        HardwareError: there is no such bus, this user may not use it, or another program drives it.
    """
    with ExitStack() as stack:
        bus = open_bus(config)
        stack.callback(bus.close)
        # A device is locked itself, so that nothing is left behind; a socket cannot be opened.
        path = f"{bus.name}.lock" if config.socket else bus.name
        lock = os.open(path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o600)
        stack.callback(os.close, lock)
        _lock(lock, bus.name)
        yield bus


def _lock(lock: int, name: str) -> None:
    try:
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError as error:
        raise HardwareError(
            f"{name}: expected to be the only program that drives, another one has the bus"
            f"{_owner(lock)}; end that one first (`python -m robot off` switches its coils off)"
        ) from error


def _owner(lock: int) -> str:
    """Which process holds the lock, as far as the kernel tells: proc(5), /proc/locks."""
    inode = os.fstat(lock).st_ino
    try:
        with open("/proc/locks", encoding="ascii") as lines:
            fields = [line.split() for line in lines]
    except OSError:
        return ""
    for _, kind, _, _, process, where, *_ in (f for f in fields if len(f) >= 8):
        if kind == "FLOCK" and where.rpartition(":")[2] == str(inode):
            return f" (process {process})"
    return ""
