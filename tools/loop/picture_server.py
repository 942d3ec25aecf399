"""The virtual cameras' side of the sockets that `robot.camera.streams` opens."""

from __future__ import annotations

import contextlib
import socket
from collections.abc import Callable
from pathlib import Path

import numpy as np

from robot.camera.streams import HEADER, MAGIC, NEXT
from robot.computer.local_socket import receive_exactly
from tools.loop.devices import Listener


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
