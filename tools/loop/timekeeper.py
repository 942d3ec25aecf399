"""Who gives time to the processes of the bench: a conductor in lock-step, or the wall clock.

In lock-step nothing happens while anybody still works: time goes on to the next moment that
somebody waits for, and those who are due run one after the other. So a drive is the same on every
machine, however slow.
"""

from __future__ import annotations

import select
import socket
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from robot.computer.clock import Clock, MonotonicClock
from robot.computer.threads import Worker
from robot.errors import HardwareError
from sim_pybullet.virtual.clock import VirtualClock
from tools.loop.devices import Listener
from tools.loop.shared_time import SharedTime
from tools.loop.stepper import GO, IDLE

LOOK_S = 0.05  # real time between two looks at who has come
PATIENCE_S = 120.0  # real time that a process may work on one moment
START_S = 1000.0  # no process may take the beginning of time for "never"


class BenchError(HardwareError):
    """A process of the bench died or hangs."""


@dataclass
class Event:
    """Something that happens again and again."""

    period_s: float
    happen: Callable[[], None]
    due_s: float


class Timekeeper(Worker):
    """The wall clock gives time to everybody; what only lock-step needs does nothing here.

    Once started, hardware answers in this thread: a motor's driver does not wait for a picture to
    be drawn.
    """

    def __init__(self, clock: Clock | None = None) -> None:
        super().__init__("hardware")
        self.clock = clock or MonotonicClock()
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

    def woken(self, name: str) -> None:
        """A process was sent something that wakes it."""

    def poked(self, name: str) -> None:
        """A process was sent something that wakes it: wait until it is done with it."""
        self.woken(name)
        self.settle()

    def run_until(self, time_s: float) -> None:
        """Let everybody live until the clock reads ``time_s`` [s]; what was missed is skipped.

        HardwareError: nothing answers any more.
        """
        self.check()
        self.settle()
        while True:
            self._go_on_to(min([*(e.due_s for e in self._events), *self._awaited_s(), time_s]))
            self._happen()
            if self.clock.now() >= time_s:
                return

    def _awaited_s(self) -> list[float]:
        """The moments that processes wait for."""
        return []

    def _go_on_to(self, time_s: float) -> None:
        self.clock.sleep(time_s - self.clock.now())

    def _happen(self) -> None:
        """All that is due by now."""
        now_s = self.clock.now() + 1e-9
        for event in list(self._events):
            if event.due_s <= now_s:
                event.due_s = max(event.due_s + event.period_s, now_s)
                event.happen()
                self.settle()

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


@dataclass
class Participant:
    """A process in lock-step."""

    name: str
    connection: socket.socket
    until_s: float = 0.0
    idle: bool = False
    frozen: bool = False
    let_go: int = 0  # so many times


class Conductor(Timekeeper):
    """Lock-step, by sockets in ``folder``; who is due at the same moment runs in this order."""

    def __init__(self, folder: Path, order: tuple[str, ...]) -> None:
        self._time = VirtualClock(START_S)
        super().__init__(self._time)
        self.path, self.time_path = folder / "conductor", folder / "time"
        self.shared = SharedTime(self.time_path, create=True)
        self.shared.set("now", self.clock.now())
        self._order = order
        self._participants: dict[str, Participant] = {}
        self._listener = socket.socket(socket.AF_UNIX)
        self._listener.bind(str(self.path))
        self._listener.listen()

    def prefix(self, name: str) -> list[str]:
        """Starts a program in step."""
        return ["-m", "tools.loop.in_step", str(self.path), str(self.time_path), name]

    def joined(self, name: str, process_alive: Callable[[], bool]) -> None:
        """Wait until it asks for time; BenchError when it ended before."""
        deadline_s = time.monotonic() + PATIENCE_S
        if before := self._participants.pop(name, None):  # of before, whose end nobody heard yet
            before.connection.close()
        while name not in self._participants:
            super().joined(name, lambda: process_alive() and time.monotonic() < deadline_s)
            if select.select([self._listener], [], [], 0.05)[0]:
                connection = self._listener.accept()[0]
                told = connection.recv(16, socket.MSG_WAITALL).decode().strip()
                self._participants[told] = Participant(told, connection)

    def freeze(self, name: str, frozen: bool) -> None:
        """A process that was stopped (SIGSTOP) is not waited for."""
        if name in self._participants:
            self._participants[name].frozen = frozen

    def woken(self, name: str) -> None:
        """A process was sent something that wakes it."""
        participant = self._participants.get(name)
        if participant is not None and not participant.frozen:
            participant.idle = False

    def _awaited_s(self) -> list[float]:
        return [p.until_s for p in self._participants.values() if not p.frozen]

    def _go_on_to(self, time_s: float) -> None:
        self._time.advance_to(time_s)
        self.shared.set("now", self.clock.now())

    def settle(self) -> None:
        """Serve until every process waits; BenchError: one works on this moment for too long."""
        deadline_s = time.monotonic() + PATIENCE_S
        while True:
            busy = [p for p in self._participants.values() if not (p.idle or p.frozen)]
            self._listen(1.0 if busy else 0.0)
            if not busy:
                return
            if time.monotonic() > deadline_s:
                names = ", ".join(p.name for p in busy)
                raise BenchError(f"{names}: no end to its work at {self.clock.now():.3f} s")

    def end(self) -> None:
        """Give nobody time any more; processes in step end by that."""
        for participant in self._participants.values():
            participant.connection.close()
        self._listener.close()

    def _happen(self) -> None:
        """All that is due by now; then whoever waited for it goes on."""
        super()._happen()
        for name in self._order:
            participant = self._participants.get(name)
            if participant is None or participant.frozen:
                continue
            if participant.until_s <= self.clock.now() + 1e-9:
                participant.idle = False
                participant.let_go += 1
                participant.connection.sendall(GO)
                self.settle()

    def _listen(self, wait_s: float) -> None:
        """Read what participants say and serve the hardware, once."""
        by_fd = {p.connection.fileno(): p for p in self._participants.values()}
        fds = [fd for service in self._services for fd in service.filenos()]
        ready = select.select([*by_fd, *fds], [], [], wait_s)[0]
        if any(fd not in by_fd for fd in ready):
            for service in self._services:
                service.serve()
        for fd in ready:
            if fd in by_fd:
                self._hear(by_fd[fd])

    def _hear(self, participant: Participant) -> None:
        try:
            data = participant.connection.recv(IDLE.size, socket.MSG_WAITALL)
        except OSError:
            data = b""
        if len(data) < IDLE.size:
            participant.connection.close()
            del self._participants[participant.name]
            return
        until_s, let_go = IDLE.unpack(data)
        # a thread that ended by itself may have said so once too often, before it was let go on
        if let_go == participant.let_go:
            participant.until_s, participant.idle = until_s, True
