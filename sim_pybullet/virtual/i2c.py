"""An I2C bus in memory, with Linux's errors and the faults that real wires have."""

from __future__ import annotations

import errno
from collections import deque
from enum import Enum

from sim_pybullet.virtual.pca9685_registers import Pca9685Registers


class BusFault(Enum):
    """What can go wrong with a transaction."""

    NACK = "nobody acknowledges the address"
    STUCK = "SDA or SCL is held low"
    PARTIAL = "the chip stops acknowledging half-way"


class VirtualI2cBus:
    """A bus that implements ``robot.hat.bus.I2cBus`` over attached chips."""

    name = "virtual I2C bus"  # as a person would see it in a message

    def __init__(self) -> None:
        self._devices: list[Pca9685Registers] = []
        self._faults: deque[BusFault | None] = deque()

    def attach(self, device: Pca9685Registers) -> None:
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
        device, partial = self._answering(address, len(data))
        sent = data[: len(data) // 2] if partial else data
        if not device.write(bytes(sent)) or partial:
            raise OSError(errno.EREMOTEIO, "Remote I/O error")

    def read(self, address: int, register: int, count: int) -> bytes:
        """One write and one read message joined by a repeated START."""
        device, partial = self._answering(address, count)
        if not device.write(bytes((register,))) or partial:
            raise OSError(errno.EREMOTEIO, "Remote I/O error")
        return device.read(register, count)

    def _answering(self, address: int, size: int) -> tuple[Pca9685Registers, bool]:
        """Who answers, and whether only half-way."""
        if size == 0:  # i2c-tegra declares I2C_AQ_NO_ZERO_LEN, and the kernel answers for it
            raise OSError(errno.EOPNOTSUPP, "Operation not supported: message of zero length")
        fault = self._faults.popleft() if self._faults else None
        if fault is BusFault.STUCK:
            raise OSError(errno.ETIMEDOUT, "Connection timed out")
        there = [device for device in self._devices if device.address == address]
        if fault is BusFault.NACK or not there:
            raise OSError(errno.EREMOTEIO, "Remote I/O error")
        return there[0], fault is BusFault.PARTIAL
