"""The bench as the wall clock goes: the processes run as they would anywhere."""

from __future__ import annotations

import select
import threading
import time
from collections.abc import Callable

from robot.hat.clock import MonotonicClock
from tools.loop.conductor import BenchError, Event, Service

START_PATIENCE_S = 60.0


class RealTime:
    """Does what `tools.loop.conductor.Conductor` does, without giving time to anybody.

    Hardware answers in a thread of its own: a motor's driver does not wait for a picture to be
    drawn.
    """

    def __init__(self) -> None:
        self.clock = MonotonicClock()
        self._events: list[Event] = []
        self._services: list[Service] = []
        self._closing = threading.Event()
        self._thread = threading.Thread(target=self._serve, name="hardware", daemon=True)
        self._thread.start()

    def prefix(self, name: str) -> list[str]:  # noqa: ARG002  who starts is the same here
        """What goes between ``python`` and the program's module."""
        return ["-m"]

    def add_service(self, service: Service) -> None:
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
        """Processes join by themselves; BenchError when one has ended already."""
        if not process_alive():
            raise BenchError(f"{name}: expected it to start, it did not; see its log")

    def freeze(self, name: str, frozen: bool) -> None:
        """Nobody is waited for anyway."""

    def poked(self, name: str) -> None:
        """The same."""

    def woken(self, name: str) -> None:
        """The same."""

    def lossy(self, lossy: bool) -> None:
        """The same."""

    def slow(self, decision_s: float) -> None:
        """Not possible: decisions take the time that they take.

        Raises:
            BenchError: always.
        """
        if decision_s:
            raise BenchError("expected lock-step, to slow decisions down; got real time")

    def run_until(self, time_s: float) -> None:
        """Let things happen until the clock reads ``time_s`` [s]; what was missed is skipped."""
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

    def settle(self) -> None:
        """Nobody is waited for."""

    def close(self) -> None:
        """Stop serving."""
        self._closing.set()
        self._thread.join()

    def _serve(self) -> None:
        while not self._closing.is_set():
            services = list(self._services)
            fds = [fd for service in services for fd in service.filenos()]
            if fds and select.select(fds, [], [], 0.05)[0]:
                for service in services:
                    service.serve()
            elif not fds:
                time.sleep(0.01)
