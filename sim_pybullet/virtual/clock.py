"""Time that moves only when told to: for tests and for simulation faster than real time."""

import math

from robot.hat.driver import MotorDriver


class VirtualClock:
    """A clock for lock-step simulation (``robot.computer.clock.Clock``)."""

    def __init__(self, start_s: float = 0.0) -> None:
        self._now_s = start_s

    def now(self) -> float:
        """Time since the simulation's beginning [s]."""
        return self._now_s

    def sleep(self, duration_s: float) -> None:
        """Move on by ``duration_s`` [s]."""
        self.advance_to(self._now_s + max(duration_s, 0.0))

    def advance_to(self, time_s: float) -> None:
        """Move on to ``time_s`` [s]; time never runs backwards."""
        assert math.isfinite(time_s)
        self._now_s = max(self._now_s, time_s)


def run_until(driver: MotorDriver, clock: VirtualClock, time_s: float) -> None:
    """Pump ``driver`` at each of its deadlines until the clock reads ``time_s`` [s]."""
    while True:
        deadline_s = driver.pump(clock.now())
        next_s = math.inf if deadline_s is None else deadline_s
        if next_s > time_s:
            break
        clock.advance_to(next_s)
    clock.advance_to(time_s)
