"""The outputs of a PCA9685 over one PWM period of 4096 counts (data sheet, chapter 7.3.3)."""

from __future__ import annotations

from typing import NamedTuple

COUNTS = 4096
FULL = 0x10  # bit 4 of ON_H and OFF_H


class ChipMisuseError(AssertionError):
    """The driver did what a data sheet forbids."""


class Output(NamedTuple):
    """High from count ``on`` to count ``off``, unless it is constant."""

    on: int
    off: int
    constant: bool
    inverted: bool

    def high(self, count: int) -> bool:
        """Whether the pin is high at ``count``; of a constant output, ``on`` > 0 says it."""
        high = (
            self.on > 0
            if self.constant
            else (count - self.on) % COUNTS < (self.off - self.on) % COUNTS
        )
        return high != self.inverted

    @classmethod
    def from_registers(cls, registers: bytes, inverted: bool) -> Output:
        """Four registers ON_L, ON_H, OFF_L, OFF_H; full OFF wins over full ON."""
        if registers[3] & FULL:
            return cls(0, 0, True, inverted)
        if registers[1] & FULL:
            return cls(1, 0, True, inverted)
        on = registers[0] | (registers[1] & 0x0F) << 8
        off = registers[2] | (registers[3] & 0x0F) << 8
        if on == off:
            raise ChipMisuseError(f"ON and OFF counts are both {on}: they must never be equal")
        return cls(on, off, False, inverted)


class PwmOutputs(NamedTuple):
    """All sixteen."""

    channels: tuple[Output, ...]

    @classmethod
    def all_low(cls) -> PwmOutputs:
        """Every pin low, whatever the registers say."""
        return cls((Output(0, 0, True, False),) * 16)

    @classmethod
    def from_registers(cls, led: bytes, inverted: bool, cut_off: int | None = None) -> PwmOutputs:
        """The 64 LED registers; a write was cut off within the channel ``cut_off``.

        That channel may have equal counts for once, until the next write. What the chip then does
        the data sheet does not say; here it is low.
        """
        channels = []
        for number in range(16):
            registers = led[4 * number : 4 * number + 4]
            if number == cut_off and registers[0:2] == registers[2:4]:
                registers = b"\0\0\0\x10"  # full OFF
            channels.append(Output.from_registers(registers, inverted))
        return cls(tuple(channels))

    @property
    def any_pwm(self) -> bool:
        """Whether a pin switches within the period."""
        return any(not output.constant for output in self.channels)

    @property
    def any_high(self) -> bool:
        """Whether a pin is high at some time."""
        return any(not output.constant or output.high(0) for output in self.channels)

    def spans(self, *channels: int) -> list[tuple[float, tuple[bool, ...]]]:
        """The period cut where one of ``channels`` switches: (share of it, level of each)."""
        outputs = [self.channels[channel] for channel in channels]
        cuts = {c for o in outputs if not o.constant for c in (o.on, o.off)}
        edges = sorted({0, COUNTS} | cuts)
        return [
            ((edges[i + 1] - start) / COUNTS, tuple(o.high(start) for o in outputs))
            for i, start in enumerate(edges[:-1])
        ]

    def duty(self, channel: int) -> float:
        """Share of the period that a pin is high."""
        return sum(share for share, (high,) in self.spans(channel) if high)
