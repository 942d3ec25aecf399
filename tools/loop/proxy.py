"""A network that can be bad: TCP between two ports, delayed, stalling, or cut."""

from __future__ import annotations

import contextlib
import select
import socket
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from robot.computer.threads import Worker

TURN_S = 0.05  # real time between two looks at an idle network
BUSY_S = 0.0005
PART_BYTES = 65536


@dataclass
class _Pipe:
    """One direction of a connection; parts wait here until they are due."""

    source: socket.socket
    sink: socket.socket
    waiting: deque[tuple[float, bytes]] = field(default_factory=deque)


class Proxy(Worker):
    """Forwards ``ports``: from each key, on loopback, to its value.

    Args:
        ports: listened at, and where they lead.
        clock: time of the delays [s].
        rng: draws what is lost.
    """

    def __init__(
        self, ports: dict[int, int], clock: Callable[[], float], rng: np.random.Generator
    ) -> None:
        super().__init__("network")
        self.delay_s = 0.0
        self.loss = 0.0  # share of parts that TCP must send again
        self.again_s = 0.4  # which takes so long
        self.cut = False
        self._clock, self._rng = clock, rng
        self._pipes: list[_Pipe] = []
        self._listeners = {
            socket.create_server(("127.0.0.1", port)): to for port, to in ports.items()
        }
        self.start()

    def close(self) -> None:
        """Hang up for good."""
        self.end()
        self._hang_up()
        for listener in self._listeners:
            listener.close()

    def _work(self) -> None:
        while not self._ending.is_set():
            waiting = any(pipe.waiting for pipe in self._pipes)
            sources = [pipe.source for pipe in self._pipes]
            wait_s = BUSY_S if waiting else TURN_S
            try:
                ready = select.select([*sources, *self._listeners], [], [], wait_s)[0]
            except (OSError, ValueError):
                ready = []
            if self.cut:
                self._hang_up()
            for listener, port in self._listeners.items():
                if listener in ready:
                    self._accept(listener, port)
            for pipe in list(self._pipes):
                if pipe.source in ready:
                    self._read(pipe)
                self._forward(pipe)

    def _accept(self, listener: socket.socket, port: int) -> None:
        near, far = listener.accept()[0], socket.socket()
        try:
            if self.cut:
                raise OSError("cut")
            far.connect(("127.0.0.1", port))
        except OSError:
            near.close()
            far.close()
            time.sleep(BUSY_S)
            return
        for end in (near, far):
            end.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._pipes += [_Pipe(near, far), _Pipe(far, near)]

    def _read(self, pipe: _Pipe) -> None:
        try:
            data = pipe.source.recv(PART_BYTES)
        except OSError:
            data = b""
        if not data:
            self._drop(pipe)
            return
        due_s = self._clock() + self.delay_s
        if self.loss and self._rng.random() < self.loss:
            due_s += self.again_s
        if pipe.waiting:  # TCP keeps the order
            due_s = max(due_s, pipe.waiting[-1][0])
        pipe.waiting.append((due_s, data))

    def _forward(self, pipe: _Pipe) -> None:
        while pipe.waiting and pipe.waiting[0][0] <= self._clock():
            data = pipe.waiting.popleft()[1]
            try:
                pipe.sink.sendall(data)
            except OSError:
                self._drop(pipe)
                return

    def _drop(self, pipe: _Pipe) -> None:
        ends = {pipe.source, pipe.sink}
        self._pipes = [p for p in self._pipes if not ends & {p.source, p.sink}]
        for end in ends:
            end.close()

    def _hang_up(self) -> None:
        for pipe in list(self._pipes):
            with contextlib.suppress(OSError):
                self._drop(pipe)
