"""Pictures from a Unix socket: a virtual camera in another process.

The reader asks for the next picture with one byte; the camera answers at its own next moment with
a header and the pixels, RGB row by row.
"""

from __future__ import annotations

import struct
from typing import Optional, Tuple

import numpy as np

from robot.errors import ContractError, HardwareError
from robot.local_socket import connect_local, receive_exactly

NEXT = b"n"
HEADER = struct.Struct("!4sHH")  # magic, width, height
MAGIC = b"RGB8"
SILENCE_S = 2.0


class SocketStream:
    """The camera that listens at ``path``; keeps `robot.camera.newest.Stream`.

    Args:
        path: of the socket.
        size_px: width and height that every picture must have; None takes any.

    Raises:
        HardwareError: nobody listens there.
    """

    def __init__(self, path: str, size_px: Optional[Tuple[int, int]] = None) -> None:
        self._path, self._size_px = path, size_px
        self._socket = connect_local(path, "a virtual camera", SILENCE_S)

    def grab(self) -> np.ndarray:
        """The next picture (H, W, 3) uint8 RGB.

        Raises:
            HardwareError: none came, or something else than a picture.
            ContractError: one of another size.
        """
        try:
            self._ask()
            return self._take()
        except OSError as error:
            what = error.strerror or f"no picture for {SILENCE_S:g} s"
            raise HardwareError(f"camera {self._path}: expected a picture, got: {what}") from error

    def close(self) -> None:
        """Hang up."""
        self._socket.close()

    def _ask(self) -> None:
        self._socket.sendall(NEXT)

    def _take(self) -> np.ndarray:
        magic, width, height = HEADER.unpack(receive_exactly(self._socket, HEADER.size))
        wanted = "a picture" if self._size_px is None else "{} x {} px".format(*self._size_px)
        told = f"camera {self._path}: expected {wanted}, got {magic!r} {width} x {height}"
        if magic != MAGIC:
            raise HardwareError(told)
        data = receive_exactly(self._socket, 3 * width * height)
        if self._size_px is not None and (width, height) != self._size_px:
            raise ContractError(told)
        return np.frombuffer(data, np.uint8).reshape(height, width, 3)
