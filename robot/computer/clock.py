"""Time by a clock that nobody can set, and waiting by it, also for another thread."""

import math
import os
import select
import threading
import time
import weakref
from typing import Optional, Protocol

# Descriptors from here on are too great for select; poll takes them, but counts in milliseconds,
# which is coarse for motor steps.
_SELECTABLE = 1024


class Clock(Protocol):
    """A clock that never jumps, and waiting by it."""

    def now(self) -> float:
        """Time since some fixed moment [s]."""

    def sleep(self, duration_s: float) -> None:
        """Return once ``duration_s`` [s] have passed; at once where it is not positive."""


class MonotonicClock:
    """The steady clock of the operating system."""

    def now(self) -> float:
        """``time.monotonic`` [s]."""
        return time.monotonic()

    def sleep(self, duration_s: float) -> None:
        """``time.sleep``, which does not mind the wall clock being set."""
        if duration_s > 0.0:
            time.sleep(duration_s)


class Alarm:
    """As ``threading.Event``, whose timed waits go by the wall clock in Python 3.8.

    There a wait of 50 ms lasts an hour longer when somebody sets the clock back by an hour; so do
    those of conditions, queues and joins. ``select`` waits for a span of time, whatever the wall
    clock does. An alarm costs two descriptors until it is garbage.
    """

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._rings = False
        self._read_fd, self._write_fd = os.pipe()
        for fd in (self._read_fd, self._write_fd):
            weakref.finalize(self, os.close, fd)

    def is_set(self) -> bool:
        """Whether it rings."""
        return self._rings

    def set(self) -> None:
        """Ring until ``clear``: whoever waits goes on."""
        with self._lock:
            if not self._rings:
                self._rings = True
                os.write(self._write_fd, b"\0")

    def clear(self) -> None:
        """Ring no longer."""
        with self._lock:
            if self._rings:
                self._rings = False
                os.read(self._read_fd, 1)

    def wait(self, timeout_s: Optional[float] = None) -> bool:
        """Until it rings, or for ``timeout_s`` [s]; whether it rings."""
        if timeout_s is not None:
            timeout_s = max(timeout_s, 0.0)
        if self._read_fd < _SELECTABLE:
            select.select([self._read_fd], [], [], timeout_s)
        else:
            poll = select.poll()
            poll.register(self._read_fd, select.POLLIN)
            poll.poll(None if timeout_s is None else math.ceil(1e3 * timeout_s))
        return self._rings
