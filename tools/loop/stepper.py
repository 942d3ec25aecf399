"""A process's side of lock-step: who of its threads waits for when. Python 3.8.

When the last running thread begins to wait, the conductor is told until when; when the conductor
lets the process go on, the thread that is due first is woken, and then the next.
"""

from __future__ import annotations

import _thread
import contextlib
import math
import os
import socket
import struct
from collections.abc import Iterator
from contextlib import contextmanager

from tools.loop.shared_time import SharedTime

IDLE = struct.Struct("!dI")  # until when [s], and how many times it was let go on
GO = b"g"
SOON_S = 1e-9
LATE_S = 1e-7  # waits end a little late, as anywhere: rounding must not let one end too early


class Waiter:
    """One thread that waits until ``deadline_s`` [s], or until it is released."""

    def __init__(self, stepper: Stepper, deadline_s: float = math.inf) -> None:
        self.deadline_s = deadline_s
        self.timed_out = self._taken = False
        self._stepper = stepper
        self._gate = _thread.allocate_lock()
        self._gate.acquire()

    def block(self) -> bool:
        """Wait; False when the time was over before a release."""
        self._stepper.begin_wait(self)
        try:
            self._gate.acquire()
        except BaseException:  # a signal's handler raised
            self._stepper.give_up(self)
            raise
        return not self.timed_out

    def acquire(self, blocking: bool = True, timeout_s: float | None = None) -> bool:
        """As the lock that each wait of a `threading.Condition` takes, and then waits for."""
        if self._taken:
            self.deadline_s = self._stepper.deadline(timeout_s if blocking else 0.0)
            return self.block()
        self._taken = True
        return True

    def release(self) -> None:
        """Wake the thread."""
        self._stepper.wake(self)

    def open(self) -> None:
        """Let the thread run; called by the stepper."""
        self._gate.release()


class Stepper:
    """Counts the running threads of this process, and speaks to the conductor."""

    def __init__(self, connection: socket.socket, shared: SharedTime) -> None:
        self._connection, self._shared = connection, shared
        self._lock = _thread.allocate_lock()
        self._running, self._let_go = 1, 0
        self._waiters: list[Waiter] = []
        self._early: list[Waiter] = []  # released before they began to wait

    def now(self) -> float:
        """The conductor's time [s]."""
        return self._shared.get("now")

    def start(self) -> None:
        """Listen to the conductor, in a thread that does not count."""
        _thread.start_new_thread(self._listen, ())

    def deadline(self, timeout_s: float | None) -> float:
        """When a wait of this length ends [s]."""
        return math.inf if timeout_s is None else self.now() + max(timeout_s, 0.0) + LATE_S

    def sleep(self, duration_s: float) -> None:
        """As ``time.sleep``."""
        Waiter(self, self.deadline(duration_s)).block()

    def begin_wait(self, waiter: Waiter) -> None:
        """The calling thread waits from now on."""
        with self._lock:
            if waiter in self._early:
                self._early.remove(waiter)
                waiter.open()
                return
            self._waiters.append(waiter)
            self._running -= 1
            self._look()

    def wake(self, waiter: Waiter) -> None:
        """Somebody released a waiter."""
        with self._lock:
            if waiter in self._waiters:
                self._wake(waiter)
            elif not waiter.timed_out:
                self._early.append(waiter)

    def give_up(self, waiter: Waiter) -> None:
        """The thread of this waiter runs again by itself, if it does not already."""
        with self._lock:
            if waiter in self._waiters:
                self._waiters.remove(waiter)
                self._running += 1

    def thread_begins(self) -> None:
        """A thread was started; called by who starts it."""
        with self._lock:
            self._running += 1

    def thread_ends(self) -> None:
        """A thread is over; called by itself."""
        with self._lock:
            self._running -= 1
            self._look()

    @contextmanager
    def elsewhere(self) -> Iterator[None]:
        """The calling thread waits for something outside: a picture, another thread's end."""
        self.thread_ends()
        try:
            yield
        finally:
            self.thread_begins()

    def _look(self) -> None:
        """With the lock: when nobody runs, wake who is due, or tell the conductor."""
        if self._running > 0:
            return
        first = min(self._waiters, key=lambda w: w.deadline_s, default=None)
        if first is not None and first.deadline_s <= self.now() + SOON_S:
            first.timed_out = True
            self._wake(first)
        else:
            until_s = math.inf if first is None else first.deadline_s
            self._connection.sendall(IDLE.pack(until_s, self._let_go))

    def _wake(self, waiter: Waiter) -> None:
        self._waiters.remove(waiter)
        self._running += 1
        waiter.open()

    def _listen(self) -> None:
        with contextlib.suppress(OSError):
            while self._connection.recv(1) == GO:
                with self._lock:
                    self._let_go += 1
                    self._look()
        os._exit(3)  # the bench is gone: nobody would give this process time any more
