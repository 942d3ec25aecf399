"""The bench as the wall clock goes: the processes run as they would anywhere."""

from __future__ import annotations

import select
import time

from robot.computer.clock import MonotonicClock
from robot.computer.threads import Worker
from tools.loop.timekeeper import Service, Timekeeper

LOOK_S = 0.05


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

        Raises:
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

    def __init__(self, services: list[Service]) -> None:
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
