"""Two steppers on a PCA9685 and TB6612 HAT: every change of the coils is one bus transaction."""

from itertools import chain, cycle
from typing import Dict, Optional, Sequence

from robot.computer.clock import Clock
from robot.errors import HardwareError
from robot.hat.bus import I2cBus, Pca9685
from robot.hat.config import PORTS, HatConfig, MotorConfig, ring_levels
from robot.hat.stepping import Steps


class StepperHat:
    """The HAT named by ``config``; ``open`` must come first. HardwareError when bus or chip fail.

    When both motors step, channels 3 to 12 go out as one 41-byte message and change together on
    STOP; when one does, only its four. Where the duties change, between half steps, PWMA and PWMB
    go along: 49 bytes, and 25.
    """

    def __init__(self, bus: I2cBus, config: HatConfig, clock: Clock) -> None:
        self._bus, self._config, self._clock = bus, config, clock
        self._chip: Optional[Pca9685] = None
        self._motors = (config.left, config.right)
        self._positions = [0, 0]  # around each ring [microsteps]
        self._sent: Dict[int, float] = {}  # levels of the channels; empty while all are off
        self._looks = cycle(_looks(self._motors))
        self.duty: Optional[float] = None  # of the coils now; None while they are off

    @property
    def chip(self) -> Pca9685:
        """The chip that answered."""
        if self._chip is None:
            raise HardwareError(f"{self._bus.name}: the HAT was not opened")
        return self._chip

    def open(self) -> None:
        """Find the chip and set it up; the coils are off and the wheels turn freely."""
        self.duty, self._sent = None, {}
        self._chip = Pca9685.probe(self._bus, self._config.addresses, self._clock)
        self._chip.initialise()

    def energise(self, duty: float, beside_full_steps: float = 0.0) -> None:
        """Current in the coils of the present positions, or of those so far beside them."""
        self.duty = duty
        self._write(self._motors, beside_full_steps * self._config.microsteps)

    def move(self, steps: Steps) -> None:
        """Turn the fields by ``steps`` microsteps (forward positive) at the run duty."""
        for index, count in enumerate(steps):
            self._positions[index] += -count if self._motors[index].reversed else count
        changed: Sequence[MotorConfig] = self._motors
        if self.duty == self._config.run_duty:
            changed = tuple(m for m, count in zip(self._motors, steps) if count)
        self.duty = self._config.run_duty
        if changed:
            self._write(changed)

    def release(self) -> None:
        """All outputs off in one write of three bytes; nothing to do before the first ``open``."""
        if self._chip is not None:
            self._chip.all_off()
        self.duty, self._sent = None, {}

    def check(self) -> None:
        """HardwareError unless the chip still holds what was written; while the coils are on.

        One look each time, in turn: 0.7 ms at 100 kHz, so that a step is hardly late for it.
        """
        channel = next(self._looks)
        if channel is None:
            self.chip.check()
        else:
            self.chip.expect_channel(channel, self._sent[channel])

    def _write(self, motors: Sequence[MotorConfig], beside: float = 0.0) -> None:
        """Write the run of channels that covers the coils of ``motors`` in one transaction."""
        levels: Dict[int, float] = {}
        for motor, position in zip(self._motors, self._positions):
            inputs = ring_levels(position + beside, self._config.microsteps, self.duty or 0.0)
            levels.update(zip(PORTS[motor.port], inputs))
        pwms = [c for motor in motors for c in PORTS[motor.port][::5]]  # PWMA and PWMB
        with_pwm = any(self._sent.get(c) != levels[c] for c in pwms)
        if with_pwm and self._sent:
            # This write would hide that another program switched everything off since the last.
            self.chip.expect_channel(pwms[0], self._sent[pwms[0]])
        part = slice(0, 6) if with_pwm else slice(1, 5)  # of pwma, ain2, ain1, bin1, bin2, pwmb
        span = [channel for motor in motors for channel in PORTS[motor.port][part]]
        run = range(min(span), max(span) + 1)
        self.chip.set_channels(run[0], [levels[channel] for channel in run])
        self._sent.update((channel, levels[channel]) for channel in run)


def _looks(motors: Sequence[MotorConfig]) -> Sequence[Optional[int]]:
    """The order of looks: channels to read back, and None for the chip's modes. Every second
    look is at the first or the last channel. Those are PWM inputs that whole and half steps do
    not write, so that an all-off by another program shows there until somebody looks."""
    channels = sorted(chain.from_iterable(PORTS[motor.port] for motor in motors))
    outer, inner = (channels[0], channels[-1]), [*channels[1:-1], None]
    return [look for index, other in enumerate(inner) for look in (outer[index % 2], other)]
