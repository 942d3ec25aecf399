"""A PCA9685 as its registers answer on the wire (NXP data sheet Rev. 4; chapters are named below).

Where the data sheet leaves the result of an access open, and where it goes beyond what the model
knows (RESTART, an external clock, other addresses, inverted outputs, outputs that change before
STOP), it raises ChipMisuseError: a driver that does such a thing is wrong even if one chip puts up
with it. Time comes from the clock, because waking takes 500 us.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

from robot.computer.clock import Clock

COUNTS = 4096
FULL = 0x10  # bit 4 of ON_H and OFF_H


class ChipMisuseError(AssertionError):
    """The driver did what a data sheet forbids, or what the model of the chip leaves out."""


class Output(NamedTuple):
    """High for so many counts from count ``on``."""

    on: int = 0
    length: int = 0

    def high(self, count: int) -> bool:
        """Whether the pin is high at ``count``."""
        return (count - self.on) % COUNTS < self.length

    @classmethod
    def from_registers(cls, registers: bytes) -> Output:
        """Four registers ON_L, ON_H, OFF_L, OFF_H; full OFF wins over full ON."""
        if (registers[1] | registers[3]) & FULL:
            return cls(0, 0 if registers[3] & FULL else COUNTS)
        on = registers[0] | (registers[1] & 0x0F) << 8
        off = registers[2] | (registers[3] & 0x0F) << 8
        if on == off:
            raise ChipMisuseError(f"ON and OFF counts are both {on}: they must never be equal")
        return cls(on, (off - on) % COUNTS)


class PwmOutputs(NamedTuple):
    """All sixteen; at first every pin is low."""

    channels: tuple[Output, ...] = (Output(),) * 16

    @classmethod
    def from_registers(cls, led: bytes, cut_off: int | None = None) -> PwmOutputs:
        """The 64 LED registers; a write was cut off within the channel ``cut_off``.

        That channel may have equal counts for once, until the next write. What the chip then does
        the data sheet does not say; here it is low.
        """
        parts = [led[first : first + 4] for first in range(0, 64, 4)]
        if cut_off is not None and parts[cut_off][0:2] == parts[cut_off][2:4]:
            parts[cut_off] = bytes((0, 0, 0, FULL))
        return cls(tuple(map(Output.from_registers, parts)))

    @property
    def any_high(self) -> bool:
        """Whether a pin is high at some time."""
        return any(output.length for output in self.channels)

    def spans(self, *channels: int) -> list[tuple[float, tuple[bool, ...]]]:
        """The period cut where one of ``channels`` switches: (share of it, level of each)."""
        outputs = [self.channels[channel] for channel in channels]
        cuts = {c for o in outputs for c in (o.on, (o.on + o.length) % COUNTS)}
        edges = sorted({0, COUNTS} | cuts)
        return [
            ((edges[i + 1] - start) / COUNTS, tuple(o.high(start) for o in outputs))
            for i, start in enumerate(edges[:-1])
        ]


AI, SLEEP, ALLCALL = 0x20, 0x10, 0x01  # MODE1, table 5
OUTDRV = 0x04  # MODE2, table 6
MODE1, MODE2, SUBADR1, LED0, LED_END = 0x00, 0x01, 0x02, 0x06, 0x46
ALL_LED, PRE_SCALE, TEST_MODE = 0xFA, 0xFE, 0xFF
RESET_VALUES = bytes((0x11, 0x04, 0xE2, 0xE4, 0xE8, 0xE0, *(0, 0, 0, FULL) * 16))
OSCILLATOR_HZ = 25e6
OSCILLATOR_START_S = 500e-6
# Auto-increment rolls over after LED15 and after PRE_SCALE (chapter 7.3).
ROLL_OVER = {LED_END - 1: 0x00, PRE_SCALE: 0x00}


class Pca9685Registers:
    """The chip, driven by the messages of a bus; outputs change when a message ends.

    ``before_change`` is called before the outputs take new values, ``after_change`` after it.
    """

    def __init__(
        self,
        address: int,
        clock: Clock,
        before_change: Callable[[], None] = lambda: None,
        after_change: Callable[[], None] = lambda: None,
    ) -> None:
        self.address = address
        self._clock = clock
        self._before_change, self._after_change = before_change, after_change
        self._cut_off: int | None = None  # the channel within which the last write ended
        self._power_on()

    @property
    def asleep(self) -> bool:
        """Whether the oscillator is off."""
        return bool(self._registers[MODE1] & SLEEP)

    @property
    def pwm_period_s(self) -> float:
        """Duration of 4096 counts [s] (chapter 7.3.5)."""
        return 4096 * (self._registers[PRE_SCALE] + 1) / OSCILLATOR_HZ

    def power_cycle(self) -> None:
        """Supply lost and back: all registers at their reset values."""
        self._before_change()
        self._power_on()
        self._after_change()

    def write(self, data: bytes) -> bool:
        """A register's number and what is written from there on; False: one is not acknowledged."""
        if not data:
            return True
        register, values, pwm = data[0], data[1:], False
        for value in values:
            if LED_END <= register < ALL_LED:
                break
            self._write_register(register, value)
            pwm |= register >= LED0 and register != PRE_SCALE
            register = self._after(register)
        if pwm:
            inside = LED0 <= register < LED_END and (register - LED0) % 4
            self._cut_off = (register - LED0) // 4 if inside else None
            if not self.asleep and self._clock.now() < self._awake_s + OSCILLATOR_START_S:
                raise ChipMisuseError("outputs used within 500 us of waking (chapter 7.3.1)")
        self._refresh()
        return not LED_END <= register < ALL_LED

    def read(self, register: int, count: int) -> bytes:
        """So many bytes from a register on; ALL_LED registers read zero."""
        values = bytearray()
        for _ in range(count):
            if register == TEST_MODE or LED_END <= register < ALL_LED:
                raise ChipMisuseError(f"read of register 0x{register:02X}: reserved")
            values.append(self._registers[register])
            register = self._after(register)
        return bytes(values)

    def _power_on(self) -> None:
        self._registers = bytearray(RESET_VALUES.ljust(256, b"\0"))
        self._registers[PRE_SCALE] = 0x1E
        self._awake_s = 0.0  # since when the oscillator runs
        self._cut_off = None
        self.outputs = PwmOutputs()

    def _after(self, register: int) -> int:
        """The register that the next byte goes to."""
        if not self._registers[MODE1] & AI:
            return register
        return ROLL_OVER.get(register, register + 1)

    def _write_register(self, register: int, value: int) -> None:
        if register == MODE1:
            self._write_mode1(value)
        elif register == PRE_SCALE:
            if self.asleep:
                self._registers[PRE_SCALE] = max(value, 3)
        elif LED0 <= register < LED_END:
            self._registers[register] = value & (0x1F if (register - LED0) % 2 else 0xFF)
        elif ALL_LED <= register < PRE_SCALE:
            for first in range(LED0, LED_END, 4):
                self._write_register(first + register - ALL_LED, value)
        elif register == MODE2 and not value & 0x18:
            self._registers[MODE2] = value & 0x07
        else:
            raise ChipMisuseError(f"register 0x{register:02X} = 0x{value:02X}: not modelled")

    def _write_mode1(self, value: int) -> None:
        if value & ~(AI | SLEEP | ALLCALL):
            raise ChipMisuseError(f"MODE1 = 0x{value:02X}: not modelled")
        pwm = any(0 < output.length < COUNTS for output in self.outputs.channels)
        if value & SLEEP and pwm:
            raise ChipMisuseError("asleep with PWM running: needs RESTART (chapter 7.3.1.1)")
        if self.asleep and not value & SLEEP:
            self._awake_s = self._clock.now()
        self._registers[MODE1] = value

    def _refresh(self) -> None:
        """Work out the outputs afresh, telling who watches them."""
        outputs = PwmOutputs()
        if not self.asleep:
            outputs = PwmOutputs.from_registers(bytes(self._registers[LED0:LED_END]), self._cut_off)
            if not self._registers[MODE2] & OUTDRV and outputs.any_high:
                raise ChipMisuseError("OUTDRV = 0: open drain cannot drive a bridge's inputs high")
        if outputs != self.outputs:
            self._before_change()
            self.outputs = outputs
            self._after_change()
