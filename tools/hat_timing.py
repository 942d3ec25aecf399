"""How long an update of both motors takes: on the host, and on the wire."""

from __future__ import annotations

import statistics
from typing import NamedTuple

from robot.computer.clock import Clock
from robot.hat.bus import I2cBus, bus_time_s
from robot.hat.config import HatConfig
from robot.hat.pca9685 import Pca9685

UPDATE_CHANNELS = 10  # channels 3 to 12: the coils of both motors and the PWM inputs between
UPDATE_BYTES = 1 + 4 * UPDATE_CHANNELS


class UpdateTimes(NamedTuple):
    """Milliseconds per atomic update of both motors."""

    host_ms: float  # median of the call, on whatever bus was given
    bus_100khz_ms: float  # on the wire, computed
    bus_400khz_ms: float


def hat_update_ms(bus: I2cBus, config: HatConfig, clock: Clock, count: int = 200) -> UpdateTimes:
    """Measure ``count`` updates with all coils off, so that no wheel moves; ends with all off.

    Raises:
        HardwareError: no chip answers, or it fails.
    """
    chip = Pca9685.probe(bus, config.addresses, clock)
    chip.initialise()
    times_s = []
    try:
        for _ in range(count):
            start_s = clock.now()
            chip.set_channels(3, [0.0] * UPDATE_CHANNELS)
            times_s.append(clock.now() - start_s)
    finally:
        chip.all_off()
    return UpdateTimes(
        1e3 * statistics.median(times_s),
        1e3 * bus_time_s(UPDATE_BYTES, 100_000),
        1e3 * bus_time_s(UPDATE_BYTES, 400_000),
    )
