"""A driver and virtual time in one thread, for tests and for simulation faster than real time."""

from __future__ import annotations

import math

from robot.hat.driver import MotorDriver
from sim_pybullet.virtual.clock import VirtualClock


def run_until(driver: MotorDriver, clock: VirtualClock, time_s: float) -> None:
    """Pump ``driver`` at each of its deadlines until the clock reads ``time_s`` [s]."""
    while True:
        deadline_s = driver.pump(clock.now())
        next_s = math.inf if deadline_s is None else deadline_s
        if next_s > time_s:
            break
        clock.advance_to(next_s)
    clock.advance_to(time_s)
