"""The virtual hardware's side of the sockets of `robot.hat.bus` and `robot.camera.source`."""

from __future__ import annotations

import contextlib
import select
import socket
import threading
from collections.abc import Callable
from pathlib import Path

import numpy as np

from robot.camera.source import HEADER, MAGIC, NEXT
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


class PictureServer(Listener):
    """A virtual camera: who asked gets the picture of the next moment.

    ``see`` gives that of now, (H, W, 3) uint8 RGB; ``answered`` is told after it went out.
    """

    def __init__(
        self, path: Path, see: Callable[[], np.ndarray], answered: Callable[[], None]
    ) -> None:
        super().__init__(path)
        self.see, self.answered = see, answered
        self.silent = False
        self.magic = MAGIC
        self.spoil: Callable[[np.ndarray], np.ndarray] | None = None  # what a picture becomes
        self._asking: list[socket.socket] = []

    def moment(self) -> None:
        """The camera's next moment has come."""
        self.serve()
        with self._serving:
            if self.silent or not self._asking:
                return
            asking, self._asking = self._asking, []
        seen = self.see()
        picture = seen if self.spoil is None else self.spoil(seen)
        height, width = picture.shape[:2]
        data = HEADER.pack(self.magic, width, height) + picture.tobytes()
        for connection in asking:
            with contextlib.suppress(OSError):
                connection.sendall(data)
                self.answered()

    def _answer(self, connection: socket.socket) -> None:
        if receive_exactly(connection, 1) == NEXT:
            self._asking.append(connection)

    def _drop(self, connection: socket.socket) -> None:
        super()._drop(connection)
        if connection in self._asking:
            self._asking.remove(connection)
