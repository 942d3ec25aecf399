"""Keeps a loop on time: absolute deadlines on a monotonic clock, and how late it was."""

from __future__ import annotations

from robot.hat.clock import Clock

ROUNDING_S = 1e-6  # of sums of times


class RateKeeper:
    """Deadlines every ``period_s`` [s] from the first ``wait`` on.

    Attributes:
        lag_s: how long after its deadline the last turn began [s].
        missed: deadlines that passed while a turn still ran; they are skipped, not caught up.
    """

    def __init__(self, period_s: float, clock: Clock) -> None:
        self.lag_s = 0.0
        self.missed = 0
        self._period_s = period_s
        self._clock = clock
        self._deadline_s = clock.now()

    def wait(self) -> float:
        """Sleep until the next deadline; returns ``lag_s``."""
        now_s = self._clock.now()
        early_s = self._deadline_s - now_s
        if early_s > self._period_s + ROUNDING_S:  # the clock went back
            self._deadline_s, early_s = now_s, 0.0
        if early_s > 0.0:
            self._clock.sleep(early_s)
        self.lag_s = max(0.0, self._clock.now() - self._deadline_s)
        skipped = int(self.lag_s / self._period_s)
        self.missed += skipped
        self._deadline_s += (1 + skipped) * self._period_s
        return self.lag_s
