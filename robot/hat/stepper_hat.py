"""Two steppers on a PCA9685 and TB6612 HAT: every change of the coils is one bus transaction."""

from __future__ import annotations

from typing import Dict, Optional, Sequence

from robot.errors import HardwareError
from robot.hat.bus import I2cBus
from robot.hat.clock import Clock
from robot.hat.coils import ring_levels
from robot.hat.config import HatConfig, MotorConfig
from robot.hat.pca9685 import Pca9685
from robot.hat.stepping import Steps


class StepperHat:
    """The HAT named by ``config``; ``open`` must come first.

    When both motors step, channels 3 to 12 go out as one 41-byte message and change together on
    STOP; when one does, only its four. PWMA and PWMB stay high: duties are on the coil inputs.

    Raises:
        HardwareError: from every method, when bus or chip fail.
    """

    def __init__(self, bus: I2cBus, config: HatConfig, clock: Clock) -> None:
        self._bus = bus
        self._config = config
        self._clock = clock
        self._chip: Optional[Pca9685] = None
        self._motors = (config.left, config.right)
        self._positions = [0, 0]  # around each ring [microsteps]
        self.duty: Optional[float] = None  # of the coils now; None while they are off

    @property
    def chip(self) -> Pca9685:
        """The chip that answered."""
        if self._chip is None:
            raise HardwareError(f"{self._bus.name}: the HAT was not opened")
        return self._chip

    def open(self) -> None:
        """Find the chip and set it up; the coils are off and the wheels turn freely."""
        self.duty = None
        self._chip = Pca9685.probe(self._bus, self._config.addresses, self._clock)
        self._chip.initialise()

    def energise(self, duty: float, beside_full_steps: float = 0.0) -> None:
        """Current in the coils of the present positions, or of those so far beside them."""
        self.duty = duty
        self._write(self._motors, with_pwm=True, beside=beside_full_steps * self._config.microsteps)

    def move(self, steps: Steps) -> None:
        """Turn the fields by ``steps`` microsteps (forward positive) at the run duty."""
        for index, count in enumerate(steps):
            self._positions[index] += -count if self._motors[index].reversed else count
        if self.duty is None:
            self.energise(self._config.run_duty)
            return
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
        self.duty = None

    def check(self) -> None:
        """HardwareError unless the chip still holds the settings of ``open``."""
        self.chip.check()

    def _write(
        self, motors: Sequence[MotorConfig], with_pwm: bool = False, beside: float = 0.0
    ) -> None:
        """Write the run of channels that covers the coils of ``motors`` in one transaction."""
        levels = self._all_levels(beside)
        part = slice(0, 6) if with_pwm else slice(1, 5)  # of pwma, ain2, ain1, bin1, bin2, pwmb
        span = [channel for motor in motors for channel in tuple(motor.channels)[part]]
        first, last = min(span), max(span)
        self.chip.set_channels(first, [levels.get(c, 0.0) for c in range(first, last + 1)])

    def _all_levels(self, beside: float) -> Dict[int, float]:
        levels: Dict[int, float] = {}
        for motor, position in zip(self._motors, self._positions):
            pwma, ain2, ain1, bin1, bin2, pwmb = motor.channels
            coils = ring_levels(position + beside, self._config.microsteps, self.duty or 0.0)
            levels.update(zip((ain2, bin1, ain1, bin2), coils))
            levels.update({pwma: 1.0, pwmb: 1.0})
        return levels
