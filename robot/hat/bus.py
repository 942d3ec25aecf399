"""An I2C bus: what the driver asks of one, the real one under Linux, and a virtual one.

Implementations raise OSError as the kernel does (errno 121 when nobody acknowledges); the chip's
driver turns that into a HardwareError that says what to check.
"""

from __future__ import annotations

import errno
import glob
import os
import struct
from typing import Protocol, Union

from robot.computer.local_socket import connect_local, receive_exactly
from robot.errors import HardwareError

USUAL_BUSES = (1, 7)  # pins 3 and 5: of a Jetson Nano, of an Orin Nano
USUAL_ADDRESSES = (0x6F, 0x60)  # as these boards are sold


class I2cBus(Protocol):
    """One I2C bus with 7-bit addresses; every call is one transaction, START to STOP."""

    @property
    def name(self) -> str:
        """What a person calls this bus, such as ``/dev/i2c-1``."""

    def write(self, address: int, data: bytes) -> None:
        """Send all of ``data`` to ``address`` in one message."""

    def read(self, address: int, register: int, count: int) -> bytes:
        """Write the register's number, then read ``count`` bytes after a repeated START."""


def bus_time_s(data_bytes: int, bus_hz: int) -> float:
    """Time on the wire [s] of a write of ``data_bytes``: 9 bits per byte, address, START, STOP."""
    return (9 * (data_bytes + 1) + 2) / bus_hz


def bus_read_time_s(data_bytes: int, bus_hz: int) -> float:
    """The same of a read: address and register, repeated START, address and ``data_bytes``."""
    return (9 * (data_bytes + 3) + 3) / bus_hz


class SmbusBus:
    """The bus ``/dev/i2c-<number>`` through smbus2; HardwareError where this user has none.

    Uses plain I2C messages: an SMBus block write ends at 32 bytes, and both motors take 41.
    """

    def __init__(self, number: int) -> None:
        from smbus2 import SMBus, i2c_msg

        self.name = f"/dev/i2c-{number}"
        self._message = i2c_msg
        try:
            self._bus = SMBus(number)
        except OSError as error:
            present = ", ".join(sorted(glob.glob("/dev/i2c-*"))) or "none"
            told = (
                f"expected an I2C bus, got: {error.strerror or error}; present: {present}; "
                "pins 3 and 5 are bus 1 on a Jetson Nano, bus 7 on an Orin Nano"
            )
            if error.errno == errno.EACCES:
                told = "may not be opened; add the user to the group i2c, and log in again"
            raise HardwareError(f"{self.name}: {told}") from error

    def write(self, address: int, data: bytes) -> None:
        """One write message; OSError from the kernel when it is not acknowledged."""
        self._bus.i2c_rdwr(self._message.write(address, data))

    def read(self, address: int, register: int, count: int) -> bytes:
        """One write and one read message, joined by a repeated START."""
        answer = self._message.read(address, count)
        self._bus.i2c_rdwr(self._message.write(address, [register]), answer)
        return bytes(answer)

    def close(self) -> None:
        """Give the device file back."""
        self._bus.close()


REQUEST = struct.Struct("!cBBH")  # kind, address, register, number of bytes
ANSWER = struct.Struct("!HH")  # errno, number of bytes
WRITE, READ = b"w", b"r"
SILENCE_S = 1.0  # as long as Linux's adapters wait for a bus that is held low


class SocketBus:
    """The bus of virtual hardware in another process, which listens at ``path``.

    One transaction is one request and one answer. A request is its kind (``w`` or ``r``), the
    address, the register (``r``), a count, and the data (``w``); an answer is an errno, 0 for done,
    and data. HardwareError where nobody listens.
    """

    def __init__(self, path: str) -> None:
        self.name = path
        self._socket = connect_local(path, "a virtual I2C bus", SILENCE_S)

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


def open_bus(where: Union[int, str]) -> Union[SmbusBus, SocketBus]:
    """``/dev/i2c-<where>``, or the virtual bus that listens at a path; HardwareError as theirs."""
    return SmbusBus(where) if isinstance(where, int) else SocketBus(where)
