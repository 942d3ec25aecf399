"""Threads beside the control loop, and waiting for another one by a clock that nobody can set.

Whatever ends a thread before its time, somebody hears of it.
"""

from __future__ import annotations

import math
import os
import select
import threading
import weakref
from typing import Optional, TypeVar

from robot.errors import HardwareError

# Descriptors from here on are too great for select; poll takes them, but counts in milliseconds,
# which is coarse for motor steps.
_SELECTABLE = 1024


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
        weakref.finalize(self, _close, self._read_fd, self._write_fd)

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


def _close(*fds: int) -> None:
    for fd in fds:
        os.close(fd)


T = TypeVar("T", bound="Worker")


class Worker:
    """A thread in a ``with`` block, or between ``start`` and ``end``. Derive from it.

    What ends it before its time is kept, and ``check`` raises it in the thread that relies on it:
    a robot must not drive on without, say, its watchdog.

    Args:
        name: of the thread.
        patience_s: its end is waited for so long [s], because a device may hang; None for ever.
    """

    def __init__(self, name: str, patience_s: Optional[float] = None) -> None:
        self._ending, self._ended = Alarm(), Alarm()
        self._name, self._patience_s = name, patience_s
        self._thread: Optional[threading.Thread] = None
        self._died: Optional[BaseException] = None

    def __enter__(self: T) -> T:
        self.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.end()

    def start(self) -> None:
        """Begin, or begin anew after ``end``."""
        self._ending.clear()
        self._ended.clear()
        self._died = None
        self._thread = threading.Thread(target=self._run, name=self._name, daemon=True)
        self._thread.start()

    def end(self) -> None:
        """Let the work come to its end."""
        self._ending.set()
        self._wake()
        if self._thread is not None and self._ended.wait(self._patience_s):
            self._thread.join()

    def check(self) -> None:
        """Nothing, while all is well.

        Raises:
            HardwareError: the thread has died; of what.
        """
        if self._died is not None:
            told = self._died if isinstance(self._died, HardwareError) else repr(self._died)
            raise HardwareError(f"{self._name} thread: {told}") from self._died

    @property
    def alive(self) -> bool:
        """Whether the thread works."""
        return self._thread is not None and self._thread.is_alive() and self._died is None

    def _work(self) -> None:
        """What the thread does until ``self._ending`` is set."""
        raise NotImplementedError

    def _wake(self) -> None:
        """For work that waits for something else than ``self._ending``."""

    def _run(self) -> None:
        try:
            self._work()
        except BaseException as error:  # noqa: BLE001  kept for the thread that relies on this one
            self._died = error
        finally:
            self._ended.set()


class Silence:
    """Whether a thread that should turn hangs: asked ``looks`` times, and ``limit_s`` long [s].

    Both, because the thread and whoever asks may have been paused together.
    """

    def __init__(self, looks: int, limit_s: float) -> None:
        self._looks, self._limit_s = looks, limit_s
        self._heard, self._heard_s = 0, 0.0
        self._unheard = 0  # looks since then

    def lasts(self, turns: int, now_s: float) -> bool:
        """Whether it does; ``turns`` is what the thread counts up."""
        if turns != self._heard or self._unheard == 0:
            self._heard, self._heard_s, self._unheard = turns, now_s, 0
        self._unheard += 1
        return self._unheard > self._looks and now_s - self._heard_s > self._limit_s
