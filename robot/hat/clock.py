"""Time as the motor side needs it, so that a test or a simulator can supply its own."""

from __future__ import annotations

import time
from typing import Protocol


class Clock(Protocol):
    """A clock that never jumps, and waiting by it."""

    def now(self) -> float:
        """Time since some fixed moment [s]."""

    def sleep(self, duration_s: float) -> None:
        """Return once ``duration_s`` [s] have passed; at once where it is not positive."""


class MonotonicClock:
    """The steady clock of the operating system."""

    def now(self) -> float:
        """``time.monotonic`` [s]."""
        return time.monotonic()

    def sleep(self, duration_s: float) -> None:
        """``time.sleep``, which does not mind the wall clock being set."""
        if duration_s > 0.0:
            time.sleep(duration_s)
