"""A network that can be bad: TCP between two ports, delayed, stalling, or cut."""

import select
import socket
import time
from collections import deque
from collections.abc import Callable

import numpy as np

from robot.computer.threads import Worker

TURN_S = 0.05  # real time between two looks at an idle network
BUSY_S = 0.0005
PART_BYTES = 65536


class Proxy(Worker):
    """Forwards ``ports``: from each key, on loopback, to its value; delays are by ``clock`` [s]."""

    def __init__(
        self, ports: dict[int, int], clock: Callable[[], float], rng: np.random.Generator
    ) -> None:
        super().__init__("network")
        self.delay_s = 0.0
        self.loss = 0.0  # share of parts that TCP must send again
        self.again_s = 0.4  # which takes so long
        self.cut = False
        self._clock, self._rng = clock, rng
        # Where each end's parts go to, and those that wait until they are due.
        self._pipes: dict[socket.socket, tuple[socket.socket, deque[tuple[float, bytes]]]] = {}
        self._listeners = {socket.create_server(("127.0.0.1", at)): to for at, to in ports.items()}
        self.start()

    def close(self) -> None:
        """Hang up for good."""
        self.end()
        self._hang_up()
        for listener in self._listeners:
            listener.close()

    def _work(self) -> None:
        while not self._ending.is_set():
            wait_s = BUSY_S if any(parts for _, parts in self._pipes.values()) else TURN_S
            try:
                ready = select.select([*self._pipes, *self._listeners], [], [], wait_s)[0]
            except (OSError, ValueError):
                ready = []
            if self.cut:
                self._hang_up()
            for listener, port in self._listeners.items():
                if listener in ready:
                    self._accept(listener, port)
            for source in list(self._pipes):
                if source in self._pipes:
                    self._carry(source, source in ready)

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
        for end, other in ((near, far), (far, near)):
            end.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            self._pipes[end] = (other, deque())

    def _carry(self, source: socket.socket, ready: bool) -> None:
        sink, waiting = self._pipes[source]
        try:
            if ready:
                data = source.recv(PART_BYTES)
                if not data:
                    raise OSError("hung up")
                lost = self.loss and self._rng.random() < self.loss
                due_s = self._clock() + self.delay_s + (self.again_s if lost else 0.0)
                before_s = waiting[-1][0] if waiting else due_s
                waiting.append((max(due_s, before_s), data))  # TCP keeps the order
            while waiting and waiting[0][0] <= self._clock():
                sink.sendall(waiting.popleft()[1])
        except OSError:
            self._drop(source)

    def _drop(self, end: socket.socket) -> None:
        for one in (end, self._pipes[end][0]):
            del self._pipes[one]
            one.close()

    def _hang_up(self) -> None:
        while self._pipes:
            self._drop(next(iter(self._pipes)))
