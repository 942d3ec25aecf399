"""An I2C bus, the real one under Linux or a virtual one, and the NXP PCA9685 on it (sheet Rev. 4).

Implementations raise OSError as the kernel does (errno 121 when nobody acknowledges); the chip's
driver turns that into a HardwareError that says what to check. The chip has sixteen 12-bit PWM
outputs; its register auto-increment is on and outputs change on STOP, so that one write changes any
run of channels at once. It has no watchdog: outputs stay as they are until somebody writes.
"""

import errno
import glob
import os
import struct
from typing import NoReturn, Optional, Protocol, Sequence, Union

from robot.computer.clock import Clock
from robot.computer.local_socket import connect_local, receive_exactly
from robot.errors import HardwareError

USUAL_BUSES = (1, 7)  # pins 3 and 5: of a Jetson Nano, of an Orin Nano
USUAL_ADDRESSES = (0x6F, 0x60)  # as these boards are sold


class I2cBus(Protocol):
    """One I2C bus with 7-bit addresses; every call is one transaction, START to STOP."""

    name: str  # what a person calls it, such as ``/dev/i2c-1``

    def write(self, address: int, data: bytes) -> None:
        """Send all of ``data`` to ``address`` in one message."""

    def read(self, address: int, register: int, count: int) -> bytes:
        """Write the register's number, then read ``count`` bytes after a repeated START."""


def bus_time_s(data_bytes: int, bus_hz: int, messages: int = 1) -> float:
    """Time on the wire [s]: 9 bits per byte, an address and a START per message, and a STOP.

    A write is one message, a read two: the register's number, and what is read.
    """
    return (9 * (data_bytes + messages) + messages + 1) / bus_hz


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


MODE1, MODE2, LED0_ON_L, ALL_LED_OFF_H, PRE_SCALE = 0x00, 0x01, 0x06, 0xFD, 0xFE
AUTO_INCREMENT, SLEEP = 0x20, 0x10  # bits of MODE1; ALLCALL stays 0: nobody else answers for us
TOTEM_POLE = 0x04  # OUTDRV of MODE2; OCH = 0: outputs change on STOP
FULL = 0x10  # bit 4 of ON_H and OFF_H: all on, all off
CHANNELS = 16
NOBODY = (errno.EREMOTEIO, errno.ENXIO)  # acknowledges
COUNTS = 4096  # of one PWM period
FASTEST_PRE_SCALE = 3  # 25 MHz / (4096 * 4) = 1526 Hz, the highest the chip can do
OSCILLATOR_START_S = 500e-6  # section 7.3.1: before outputs may be used after waking


def channel_register(channel: int) -> int:
    """The first of a channel's four registers."""
    return LED0_ON_L + 4 * channel


def channel_bytes(level: float) -> bytes:
    """ON_L, ON_H, OFF_L, OFF_H that hold an output high for ``level`` in [0, 1] of each period."""
    counts = round(level * COUNTS)
    if counts <= 0:
        return bytes((0, 0, 0, FULL))
    if counts >= COUNTS:
        return bytes((0, FULL, 0, 0))
    return bytes((0, 0, counts & 0xFF, counts >> 8))


class Pca9685:
    """One chip at a known address. HardwareError from every method when bus or chip fail."""

    def __init__(self, bus: I2cBus, address: int, clock: Clock) -> None:
        self.bus = bus
        self.address = address
        self._clock = clock
        self._where = f"{bus.name}: PCA9685 at 0x{address:02X}"

    @classmethod
    def find(cls, bus: I2cBus, address: int, clock: Clock) -> Optional["Pca9685"]:
        """The PCA9685 at ``address``; None when nobody answers, or somebody else.

        Reads registers and never writes: a Tegra bus cannot send the empty message that other
        probes use, and a stranger at the address is left alone.
        """
        chip = cls(bus, address, clock)
        try:
            bus.read(address, MODE1, 1)
            mode2 = bus.read(address, MODE2, 1)[0]
            pre_scale = bus.read(address, PRE_SCALE, 1)[0]
        except OSError as error:
            if error.errno in NOBODY:
                return None
            chip._fail("probe", error)
        # The upper bits of MODE2 always read 0; a real-time clock also lives at 0x6F.
        return chip if mode2 & 0xE0 == 0 and pre_scale >= FASTEST_PRE_SCALE else None

    @classmethod
    def probe(cls, bus: I2cBus, addresses: Sequence[int], clock: Clock) -> "Pca9685":
        """The first of ``addresses`` where ``find`` finds one; HardwareError without any."""
        for address in addresses:
            chip = cls.find(bus, address, clock)
            if chip is not None:
                return chip
        tried = ", ".join(f"0x{address:02X}" for address in addresses)
        raise HardwareError(
            f"{bus.name}: expected a PCA9685 at {tried}, nobody answered; check that the HAT is "
            f"seated, its 3.3 V, its jumpers, `i2cdetect -y -r {bus.name.rsplit('-', 1)[-1]}`"
        )

    def initialise(self) -> None:
        """Stop whatever ran before, then set frequency and modes; all outputs end low."""
        self.all_off()
        self._write(MODE1, bytes((SLEEP | AUTO_INCREMENT,)))
        self._write(PRE_SCALE, bytes((FASTEST_PRE_SCALE,)))  # only while the oscillator sleeps
        self._write(MODE1, bytes((AUTO_INCREMENT,)))
        self._write(MODE2, bytes((TOTEM_POLE,)))
        self._clock.sleep(OSCILLATOR_START_S)
        self.check()

    def set_channels(self, first: int, levels: Sequence[float]) -> None:
        """Set neighbouring outputs, from channel ``first`` on, in one transaction."""
        self._write(channel_register(first), b"".join(channel_bytes(level) for level in levels))

    def expect_channel(self, channel: int, level: float) -> None:
        """HardwareError unless the output is still as ``set_channels`` left it.

        That tells of an all-off by another program and of writes to the channels, too: the chip
        keeps what anybody wrote last.
        """
        expected = channel_bytes(level)
        got = self._read(channel_register(channel), len(expected))
        if got != expected:
            self.check()  # a chip that was reset is told as such
            raise HardwareError(
                f"{self._where}: another program released or wrote channel {channel} (robot off, "
                f"say): expected {expected.hex()}, got {got.hex()}; end that program first"
            )

    def all_off(self) -> None:
        """Every output low: one write of three bytes on the wire."""
        self._write(ALL_LED_OFF_H, bytes((FULL,)))

    def is_off(self) -> bool:
        """Whether every output is still as ``all_off`` left it."""
        tops = (self._read(channel_register(channel) + 3, 1)[0] for channel in range(CHANNELS))
        return all(top & FULL for top in tops)

    def check(self) -> None:
        """Read the modes back: a chip that lost its supply wakes asleep and drives nothing."""
        for register, name, expected in (
            (MODE1, "MODE1", AUTO_INCREMENT),
            (MODE2, "MODE2", TOTEM_POLE),
            (PRE_SCALE, "PRE_SCALE", FASTEST_PRE_SCALE),
        ):
            value = self._read(register, 1)[0]
            if value != expected:
                raise HardwareError(
                    f"{self._where}: expected {name} = 0x{expected:02X}, got 0x{value:02X}; the "
                    "chip was reset (a dip of its 3.3 V supply?) or another program writes to it"
                )

    def _write(self, register: int, data: bytes) -> None:
        try:
            self.bus.write(self.address, bytes((register,)) + data)
        except OSError as error:
            self._fail(f"write of {len(data)} bytes to register 0x{register:02X}", error)

    def _read(self, register: int, count: int) -> bytes:
        try:
            return self.bus.read(self.address, register, count)
        except OSError as error:
            self._fail(f"read of register 0x{register:02X}", error)

    def _fail(self, what: str, error: OSError) -> NoReturn:
        if error.errno in NOBODY:
            advice = "not acknowledged: check the HAT's seat, its supply and the cable"
        else:
            advice = "the bus is stuck: look for a short on SDA or SCL, then cycle the power"
        raise HardwareError(f"{self._where}: {what} failed ({error}); {advice}") from error
