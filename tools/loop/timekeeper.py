"""What both ways of keeping the bench's time share: hardware that answers, events that recur."""

from __future__ import annotations

import select
import time
from collections.abc import Callable
from dataclasses import dataclass

from robot.computer.clock import Clock, MonotonicClock
from robot.computer.threads import Worker
from tools.loop.devices import Listener

LOOK_S = 0.05  # real time between two looks at who has come


class BenchError(RuntimeError):
    """A process of the bench died or hangs."""


@dataclass
class Event:
    """Something that happens again and again."""

    period_s: float
    happen: Callable[[], None]
    due_s: float


class Timekeeper:
    """Gives time to nobody yet; what only lock-step needs does nothing here."""

    def __init__(self, clock: Clock) -> None:
        self.clock = clock
        self._events: list[Event] = []
        self._services: list[Listener] = []

    def prefix(self, name: str) -> list[str]:  # noqa: ARG002  who starts may matter
        """What goes between ``python`` and the program's module, to start it in this time."""
        return ["-m"]

    def add_service(self, service: Listener) -> None:
        """Serve this hardware's requests from now on."""
        self._services.append(service)

    def every(self, period_s: float, happen: Callable[[], None]) -> Event:
        """Let something happen every ``period_s`` [s], first after one period."""
        event = Event(period_s, happen, self.clock.now() + period_s)
        self._events.append(event)
        return event

    def forget(self, event: Event) -> None:
        """It happens no longer."""
        self._events.remove(event)

    def joined(self, name: str, process_alive: Callable[[], bool]) -> None:
        """Wait until a process that was started has joined. BenchError: it ended before."""
        if not process_alive():
            raise BenchError(f"{name}: expected it to start, it did not; see its log")

    def freeze(self, name: str, frozen: bool) -> None:
        """A process that was stopped (SIGSTOP) is not waited for."""

    def settle(self) -> None:
        """Serve and wait until every process waits; time does not go on by that."""

    def poked(self, name: str) -> None:
        """A process was sent something that wakes it: wait until it is done with it."""

    def woken(self, name: str) -> None:
        """As ``poked``, for hardware that answers a waiting process."""

    def run_until(self, time_s: float) -> None:
        """Let everybody live until the clock reads ``time_s`` [s]."""
        raise NotImplementedError

    def close(self) -> None:
        """Give nobody time any more."""
        raise NotImplementedError


class RealTime(Timekeeper):
    """Does what `tools.loop.conductor.Conductor` does, without giving time to anybody.

    Hardware answers in a thread of its own: a motor's driver does not wait for a picture to be
    drawn.
    """

    def __init__(self) -> None:
        super().__init__(MonotonicClock())
        self._hardware = Hardware(self._services)
        self._hardware.start()

    def run_until(self, time_s: float) -> None:
        """Let things happen until the clock reads ``time_s`` [s]; what was missed is skipped.

        HardwareError: nothing answers any more.
        """
        self._hardware.check()
        while True:
            now_s = self.clock.now()
            for event in list(self._events):
                if event.due_s <= now_s:
                    event.due_s = max(event.due_s + event.period_s, now_s)
                    event.happen()
            now_s = self.clock.now()
            if now_s >= time_s:
                return
            next_s = min([e.due_s for e in self._events] + [time_s])
            time.sleep(max(0.0, next_s - now_s))

    def close(self) -> None:
        """Stop serving."""
        self._hardware.end()


class Hardware(Worker):
    """Serves the virtual hardware's sockets."""

    def __init__(self, services: list[Listener]) -> None:
        super().__init__("hardware")
        self._services = services

    def _work(self) -> None:
        while not self._ending.is_set():
            services = list(self._services)
            fds = [fd for service in services for fd in service.filenos()]
            try:
                ready = select.select(fds, [], [], LOOK_S)[0]
            except OSError:  # somebody has just hung up
                continue
            for service in services if ready else ():
                service.serve()
