"""An I2C bus on the other side of a Unix socket: virtual hardware in another process.

One transaction is one request and one answer. A request is its kind (``w`` or ``r``), the address,
the register (``r``), a count, and the data (``w``); an answer is an errno, 0 for done, and data.
"""

from __future__ import annotations

import os
import struct

from robot.computer.local_socket import connect_local, receive_exactly

REQUEST = struct.Struct("!cBBH")  # kind, address, register, number of bytes
ANSWER = struct.Struct("!HH")  # errno, number of bytes
WRITE, READ = b"w", b"r"
SILENCE_S = 1.0  # as long as Linux's adapters wait for a bus that is held low


class SocketBus:
    """The bus that listens at ``path``; keeps `robot.hat.bus.I2cBus`.

    Raises:
        HardwareError: nobody listens there.
    """

    def __init__(self, path: str) -> None:
        self._path = path
        self._socket = connect_local(path, "a virtual I2C bus", SILENCE_S)

    @property
    def name(self) -> str:
        """The socket's path."""
        return self._path

    def write(self, address: int, data: bytes) -> None:
        """One write message; OSError as the other side tells it."""
        self._socket.sendall(REQUEST.pack(WRITE, address, 0, len(data)) + data)
        self._answer()

    def read(self, address: int, register: int, count: int) -> bytes:
        """One write and one read message, joined by a repeated START."""
        self._socket.sendall(REQUEST.pack(READ, address, register, count))
        return self._answer()

    def close(self) -> None:
        """Hang up."""
        self._socket.close()

    def _answer(self) -> bytes:
        code, count = ANSWER.unpack(receive_exactly(self._socket, ANSWER.size))
        data = receive_exactly(self._socket, count)
        if code:
            raise OSError(code, os.strerror(code))
        return data
