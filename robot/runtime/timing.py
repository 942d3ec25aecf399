"""The loop on time: its deadlines, and a second thread that looks whether it still turns."""

from typing import Callable

from robot.computer.clock import Clock
from robot.computer.threads import Silence, Worker
from robot.errors import HardwareError
from robot.parts import Tick

ROUNDING_S = 1e-6  # of sums of times
PERIOD_S = 0.05  # a hanging loop is noticed so much later than its limit at most
# Without a look for so many turns and so long the watchdog hangs. Turns, too: both may have been
# paused.
TURNS, SILENCE_S = 5, 0.5


class RateKeeper:
    """Deadlines every ``period_s`` [s] from the first ``wait`` on; missed ones are skipped."""

    def __init__(self, period_s: float, clock: Clock) -> None:
        self._period_s = period_s
        self._clock = clock
        self._deadline_s = clock.now()

    def wait(self) -> float:
        """Sleep until the next deadline; returns how late the turn begins [s]."""
        now_s = self._clock.now()
        early_s = self._deadline_s - now_s
        if early_s > self._period_s + ROUNDING_S:  # the clock went back
            self._deadline_s, early_s = now_s, 0.0
        if early_s > 0.0:
            self._clock.sleep(early_s)
        lag_s = max(0.0, self._clock.now() - self._deadline_s)
        self._deadline_s += (1 + int(lag_s / self._period_s)) * self._period_s
        return lag_s


class Watchdog(Worker):
    """Calls ``watch`` every ``PERIOD_S`` in a ``with`` block; see ``Runtime.watch``.

    As a ``Subscriber`` it stops the robot when it has died itself, or looks no longer.
    """

    def __init__(self, watch: Callable[[], None]) -> None:
        super().__init__("watchdog")
        self._watch = watch
        self._looks = 0
        self._silence = Silence(TURNS, SILENCE_S)

    def on_tick(self, tick: Tick) -> None:
        """HardwareError when nobody watches any more."""
        self.check()
        if self._silence.lasts(self._looks, tick.time_s):
            raise HardwareError(f"watchdog thread: expected a look every {PERIOD_S:g} s, it hangs")

    def _work(self) -> None:
        while not self._ending.wait(PERIOD_S):
            self._watch()
            self._looks += 1
