"""An I2C bus in memory, with Linux's errors and the faults that real wires have."""

from __future__ import annotations

import errno
from collections import deque
from enum import Enum
from typing import NamedTuple, NoReturn, Protocol

from robot.hat.clock import Clock


class I2cDevice(Protocol):
    """What the bus asks of a chip, byte by byte."""

    def start(self, address: int, read: bool) -> bool:
        """START with an address; True to acknowledge."""

    def write(self, value: int) -> bool:
        """A byte from the master; True to acknowledge."""

    def read(self) -> int:
        """A byte for the master."""

    def stop(self) -> None:
        """STOP."""


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
    """A bus that implements ``robot.hat.bus.I2cBus`` over attached devices.

    Args:
        bus_hz: the bit rate, for ``busy_s``.
        clock: where given, it is moved on by the time that each transaction takes.
    """

    LOG_LENGTH = 4096

    def __init__(self, bus_hz: int = 100_000, clock: Clock | None = None) -> None:
        self.bus_hz = bus_hz
        self.busy_s = 0.0
        self.log: deque[Transaction] = deque(maxlen=self.LOG_LENGTH)
        self._clock = clock
        self._devices: list[I2cDevice] = []
        self._faults: deque[BusFault | None] = deque()

    @property
    def name(self) -> str:
        """As a person would see it in a message."""
        return "virtual I2C bus"

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
        if len(data) == 0:
            # i2c-tegra declares I2C_AQ_NO_ZERO_LEN, and the kernel answers for it.
            raise OSError(errno.EOPNOTSUPP, "Operation not supported: message of zero length")
        self._begin(Transaction(address, bytes(data), 0))
        fault = self._next_fault()
        sent = len(data) // 2 if fault is BusFault.PARTIAL else len(data)
        listeners = self._address(address, read=False)
        try:
            for value in data[:sent]:
                if not self._send(listeners, value):
                    self._not_acknowledged()
            if fault is BusFault.PARTIAL:
                self._not_acknowledged()
        finally:
            self._stop()

    def read(self, address: int, register: int, count: int) -> bytes:
        """One write and one read message joined by a repeated START."""
        if count == 0:
            raise OSError(errno.EOPNOTSUPP, "Operation not supported: message of zero length")
        self._begin(Transaction(address, bytes((register,)), count))
        fault = self._next_fault()
        listeners = self._address(address, read=False)
        try:
            if not self._send(listeners, register):
                self._not_acknowledged()
            listeners = self._address(address, read=True)
            if fault is BusFault.PARTIAL:
                self._not_acknowledged()
            return bytes(self._wired_and(listeners) for _ in range(count))
        finally:
            self._stop()

    def _begin(self, transaction: Transaction) -> None:
        self.log.append(transaction)
        messages = 2 if transaction.read_count else 1
        size = messages + len(transaction.data) + transaction.read_count
        duration_s = (9 * size + messages + 1) / self.bus_hz
        self.busy_s += duration_s
        if self._clock is not None:
            self._clock.sleep(duration_s)

    def _next_fault(self) -> BusFault | None:
        fault = self._faults.popleft() if self._faults else None
        if fault is BusFault.STUCK:
            raise OSError(errno.ETIMEDOUT, "Connection timed out")
        if fault is BusFault.NACK:
            self._not_acknowledged()
        return fault

    def _address(self, address: int, read: bool) -> list[I2cDevice]:
        listeners = [device for device in self._devices if device.start(address, read)]
        if not listeners:
            self._stop()
            self._not_acknowledged()
        return listeners

    def _stop(self) -> None:
        for device in self._devices:
            device.stop()

    @staticmethod
    def _send(devices: list[I2cDevice], value: int) -> bool:
        acknowledged = [device.write(value) for device in devices]  # all of them hear it
        return any(acknowledged)

    @staticmethod
    def _wired_and(devices: list[I2cDevice]) -> int:
        value = 0xFF
        for device in devices:
            value &= device.read()
        return value

    @staticmethod
    def _not_acknowledged() -> NoReturn:
        raise OSError(errno.EREMOTEIO, "Remote I/O error")
