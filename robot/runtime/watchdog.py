"""A second thread that looks whether the first one still turns."""

from __future__ import annotations

from typing import Callable

from robot.errors import HardwareError
from robot.parts import Tick
from robot.worker import Worker

PERIOD_S = 0.05  # a hanging loop is noticed so much later than its limit at most
# Without a look for so many turns and so long the watchdog hangs. Turns, too: both may have been
# paused.
TURNS, SILENCE_S = 5, 0.5


class Watchdog(Worker):
    """Calls ``watch`` every ``PERIOD_S`` in a ``with`` block; see ``Runtime.watch``.

    As a ``Subscriber`` it stops the robot when it has died itself, or looks no longer.
    """

    def __init__(self, watch: Callable[[], None]) -> None:
        super().__init__("watchdog")
        self._watch = watch
        self._looks = self._heard = 0
        self._unwatched = 0  # turns of the loop since ``_heard_s``
        self._heard_s = 0.0

    def on_tick(self, tick: Tick) -> None:
        """HardwareError when nobody watches any more."""
        self.check()
        if self._looks != self._heard or self._unwatched == 0:
            self._heard, self._heard_s, self._unwatched = self._looks, tick.time_s, 0
        self._unwatched += 1
        silent_s = tick.time_s - self._heard_s
        if self._unwatched > TURNS and silent_s > SILENCE_S:
            raise HardwareError(f"watchdog thread: expected a look every {PERIOD_S:g} s, it hangs")

    def _work(self) -> None:
        while not self._ending.wait(PERIOD_S):
            self._watch()
            self._looks += 1
