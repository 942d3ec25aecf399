"""Driver of the NXP PCA9685, sixteen 12-bit PWM outputs (data sheet Rev. 4).

Register auto-increment is on and outputs change on STOP, so that one write changes any run of
channels at once. The chip has no watchdog: outputs stay as they are until somebody writes.
"""

from __future__ import annotations

import errno
from typing import NoReturn, Optional, Sequence

from robot.computer.clock import Clock
from robot.errors import HardwareError
from robot.hat.bus import I2cBus

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

    @classmethod
    def find(cls, bus: I2cBus, address: int, clock: Clock) -> Optional[Pca9685]:
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
    def probe(cls, bus: I2cBus, addresses: Sequence[int], clock: Clock) -> Pca9685:
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
        """Stop whatever ran before, then set frequency and modes; all outputs end low.

        The prescaler can be written only while the oscillator sleeps.
        """
        self.all_off()
        self._write(MODE1, bytes((SLEEP | AUTO_INCREMENT,)))
        self._write(PRE_SCALE, bytes((FASTEST_PRE_SCALE,)))
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

    @property
    def _where(self) -> str:
        return f"{self.bus.name}: PCA9685 at 0x{self.address:02X}"

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
