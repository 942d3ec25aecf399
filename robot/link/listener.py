"""Listening sockets whose callers cannot use up the descriptors of this program.

Whoever reaches a port can open connections and say nothing; ZeroMQ takes each, and gives it up when
no handshake came within ``sockets.HANDSHAKE_MS``. Until then each costs a descriptor, and a program
without one can open no camera, no file and no connection. So we raise the limit to what the system
allows, and when half of that is in use we drop new connections on the floor (a filter on the
listening socket, socket(7), SO_ATTACH_FILTER; those who are in already are not touched) until
enough have been given up. The next attempt of a caller finds the door open again.
"""

from __future__ import annotations

import ctypes
import logging
import os
import socket
import struct
import sys
from contextlib import suppress
from typing import List

from robot.errors import ConfigError

logger = logging.getLogger(__name__)
WANTED = 65_536  # descriptors
SHUT_SHARE, OPEN_SHARE = 0.5, 0.4  # of the limit, in use
BACKLOG = 100
SO_ATTACH_FILTER, SO_DETACH_FILTER = 26, 27  # of asm-generic/socket.h: x86 and Arm
DROP_ALL = struct.pack("=HBBI", 0x06, 0, 0, 0)  # one instruction of BPF: return 0 bytes


def raise_limit() -> int:
    """Let this program have as many descriptors as it may, up to ``WANTED``; how many that are."""
    try:
        import resource
    except ImportError:  # no Unix
        return WANTED
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    now, most = (WANTED if n == resource.RLIM_INFINITY else min(n, WANTED) for n in (soft, hard))
    if now < most:
        with suppress(ValueError, OSError):  # macOS allows less than it says
            resource.setrlimit(resource.RLIMIT_NOFILE, (most, hard))
            return most
    return now


def lowest_free() -> int:
    """The number that the next descriptor would get: all below are in use. OSError with none."""
    number = os.open(os.devnull, os.O_RDONLY)
    os.close(number)
    return number


class Listeners:
    """The listening TCP sockets of one program. ``guard`` often; ``close`` after ZeroMQ's own."""

    def __init__(self) -> None:
        self.shut = False
        self._powerless = False  # the system lets us attach no filter
        self._limit = raise_limit()
        self._sockets: List[socket.socket] = []
        self._program = ctypes.create_string_buffer(DROP_ALL)

    def listen(self, endpoint: str) -> int:
        """A descriptor that listens at ``tcp://ADDRESS:PORT``, for ZeroMQ to own (ZMQ_USE_FD).

        ConfigError where the port is taken, or the address is not ours.
        """
        host, _, port = endpoint[len("tcp://") :].rpartition(":")
        listener = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
        try:
            listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            listener.bind(("" if host == "*" else host, int(port)))
            listener.listen(BACKLOG)
            listener.setblocking(False)
            given = os.dup(listener.fileno())
        except OSError as error:
            listener.close()
            raise ConfigError(
                f"{endpoint}: expected a free port of this machine, got: {error.strerror}; does "
                "the program run already? choose another base_port otherwise"
            ) from error
        self._sockets.append(listener)
        return given

    def guard(self) -> None:
        """Shut or open the doors to new connections, by how many descriptors are in use."""
        if not self._sockets or self._powerless or not sys.platform.startswith("linux"):
            return
        try:
            used = lowest_free()
        except OSError:
            used = self._limit
        if used >= SHUT_SHARE * self._limit and not self.shut:
            # struct sock_fprog: the number of instructions, and where they are.
            program = struct.pack("HP", 1, ctypes.addressof(self._program))
            try:
                self._set(SO_ATTACH_FILTER, program)
            except PermissionError:  # the higher limit and the handshake's time remain
                self._powerless = True
                logger.warning("half of the descriptors are in use, and the system forbids filters")
                return
            self.shut = True
        elif used < OPEN_SHARE * self._limit and self.shut:
            self._set(SO_DETACH_FILTER, struct.pack("i", 0))
            self.shut = False

    def close(self) -> None:
        """Listen no longer."""
        for listener in self._sockets:
            listener.close()
        self._sockets.clear()

    def _set(self, option: int, value: bytes) -> None:
        for listener in self._sockets:
            listener.setsockopt(socket.SOL_SOCKET, option, value)
