"""The virtual hardware's side of the sockets of `robot.hat.bus`; cameras have the next file."""

from __future__ import annotations

import select
import socket
import threading
from collections.abc import Callable
from pathlib import Path

from robot.computer.local_socket import receive_exactly
from robot.hat.bus import ANSWER, REQUEST, WRITE
from sim_pybullet.virtual.i2c import VirtualI2cBus

SILENCE_S = 5.0  # who does not read for so long is dropped


class Listener:
    """A Unix socket and who is connected to it; ``serve`` may be called by several threads."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.connections: list[socket.socket] = []
        self._serving = threading.Lock()
        self._listener = socket.socket(socket.AF_UNIX)
        self._listener.bind(str(path))
        self._listener.listen()

    def filenos(self) -> list[int]:
        """What to wait for."""
        with self._serving:
            return [self._listener.fileno(), *(c.fileno() for c in self.connections)]

    def serve(self) -> None:
        """Let in who knocks, and answer requests."""
        with self._serving:
            while select.select([self._listener], [], [], 0.0)[0]:
                connection = self._listener.accept()[0]
                connection.settimeout(SILENCE_S)
                self.connections.append(connection)
            for connection in select.select(self.connections, [], [], 0.0)[0]:
                try:
                    self._answer(connection)
                except OSError:
                    self._drop(connection)

    def hang_up(self) -> None:
        """Leave everybody who is connected; they may come again."""
        with self._serving:
            for connection in [*self.connections]:
                self._drop(connection)

    def close(self) -> None:
        """Hang up on everybody, for good."""
        self.hang_up()
        with self._serving:
            self._listener.close()

    def _answer(self, connection: socket.socket) -> None:
        raise NotImplementedError

    def _drop(self, connection: socket.socket) -> None:
        self.connections.remove(connection)
        connection.close()


class BusServer(Listener):
    """A virtual I2C bus for a driver in another process."""

    def __init__(self, path: Path, bus: VirtualI2cBus, answered: Callable[[], None]) -> None:
        super().__init__(path)
        self._bus, self._answered = bus, answered

    def _answer(self, connection: socket.socket) -> None:
        kind, address, register, count = REQUEST.unpack(receive_exactly(connection, REQUEST.size))
        code, data = 0, b""
        try:
            if kind == WRITE:
                self._bus.write(address, receive_exactly(connection, count))
            else:
                data = self._bus.read(address, register, count)
        except OSError as error:
            code, data = error.errno or 5, b""
        self._answered()
        connection.sendall(ANSWER.pack(code, len(data)) + data)
