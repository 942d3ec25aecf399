"""The outputs of a PCA9685 over one PWM period of 4096 counts (data sheet, chapter 7.3.3)."""

from __future__ import annotations

from typing import NamedTuple

COUNTS = 4096
FULL = 0x10  # bit 4 of ON_H and OFF_H


class ChipMisuseError(AssertionError):
    """The driver did what a data sheet forbids, or what the model of the chip leaves out."""


class Output(NamedTuple):
    """High from count ``on`` to count ``off``, unless it is constant: then ``on`` > 0 is high."""

    on: int = 0
    off: int = 0
    constant: bool = True

    def high(self, count: int) -> bool:
        """Whether the pin is high at ``count``."""
        if self.constant:
            return self.on > 0
        return (count - self.on) % COUNTS < (self.off - self.on) % COUNTS

    @classmethod
    def from_registers(cls, registers: bytes) -> Output:
        """Four registers ON_L, ON_H, OFF_L, OFF_H; full OFF wins over full ON."""
        if (registers[1] | registers[3]) & FULL:
            return cls(0 if registers[3] & FULL else 1)
        on = registers[0] | (registers[1] & 0x0F) << 8
        off = registers[2] | (registers[3] & 0x0F) << 8
        if on == off:
            raise ChipMisuseError(f"ON and OFF counts are both {on}: they must never be equal")
        return cls(on, off, False)


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
    def any_pwm(self) -> bool:
        """Whether a pin switches within the period."""
        return any(not output.constant for output in self.channels)

    @property
    def any_high(self) -> bool:
        """Whether a pin is high at some time."""
        return self.any_pwm or any(output.high(0) for output in self.channels)

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
