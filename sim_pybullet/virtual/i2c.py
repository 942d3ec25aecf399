"""An I2C bus in memory, with Linux's errors and the faults that real wires have."""

from __future__ import annotations

import errno
from collections import deque
from enum import Enum
from typing import NamedTuple, NoReturn, Protocol

from robot.computer.clock import Clock


class I2cDevice(Protocol):
    """What the bus asks of a chip."""

    address: int

    def write(self, data: bytes) -> bool:
        """A register's number, and what is written from there on; False: not acknowledged."""

    def read(self, register: int, count: int) -> bytes:
        """So many bytes from a register on."""


class BusFault(Enum):
    """What can go wrong with a transaction."""

    NACK = "nobody acknowledges the address"
    STUCK = "SDA or SCL is held low"
    PARTIAL = "the chip stops acknowledging half-way"


class Transaction(NamedTuple):
    """What went over the wire; ``data`` without the address byte."""

    address: int
    data: bytes
    read_count: int


class VirtualI2cBus:
    """A bus that implements ``robot.hat.bus.I2cBus`` over attached devices."""

    name = "virtual I2C bus"  # as a person would see it in a message

    def __init__(self, bus_hz: int = 100_000, clock: Clock | None = None) -> None:
        self.bus_hz = bus_hz
        self.busy_s = 0.0
        self.log: deque[Transaction] = deque(maxlen=4096)
        self._clock = clock
        self._devices: list[I2cDevice] = []
        self._faults: deque[BusFault | None] = deque()

    def attach(self, device: I2cDevice) -> None:
        """Wire a chip to the bus."""
        self._devices.append(device)

    def inject(self, fault: BusFault, count: int = 1, after: int = 0) -> None:
        """Let ``count`` transactions fail, beginning after the next ``after`` good ones."""
        self._faults.extend([None] * after + [fault] * count)

    def mend(self) -> None:
        """No fault any more."""
        self._faults.clear()

    def write(self, address: int, data: bytes) -> None:
        """One write message; OSError as Linux reports it."""
        device, partial = self._address(Transaction(address, bytes(data), 0), len(data))
        sent = data[: len(data) // 2] if partial else data
        if not device.write(bytes(sent)) or partial:
            _not_acknowledged()

    def read(self, address: int, register: int, count: int) -> bytes:
        """One write and one read message joined by a repeated START."""
        device, partial = self._address(Transaction(address, bytes((register,)), count), count)
        if not device.write(bytes((register,))) or partial:
            _not_acknowledged()
        return device.read(register, count)

    def _begin(self, transaction: Transaction) -> None:
        self.log.append(transaction)
        messages = 2 if transaction.read_count else 1
        size = messages + len(transaction.data) + transaction.read_count
        duration_s = (9 * size + messages + 1) / self.bus_hz
        self.busy_s += duration_s
        if self._clock is not None:
            self._clock.sleep(duration_s)

    def _address(self, transaction: Transaction, size: int) -> tuple[I2cDevice, bool]:
        """Who answers, and whether only half-way."""
        if size == 0:  # i2c-tegra declares I2C_AQ_NO_ZERO_LEN, and the kernel answers for it
            raise OSError(errno.EOPNOTSUPP, "Operation not supported: message of zero length")
        self._begin(transaction)
        fault = self._faults.popleft() if self._faults else None
        if fault is BusFault.STUCK:
            raise OSError(errno.ETIMEDOUT, "Connection timed out")
        there = [device for device in self._devices if device.address == transaction.address]
        if fault is BusFault.NACK or not there:
            _not_acknowledged()
        return there[0], fault is BusFault.PARTIAL


def _not_acknowledged() -> NoReturn:
    raise OSError(errno.EREMOTEIO, "Remote I/O error")
