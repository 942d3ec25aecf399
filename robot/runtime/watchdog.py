"""A second thread that looks whether the first one still turns."""

from __future__ import annotations

from typing import Callable

from robot.parts import Tick
from robot.worker import Worker

PERIOD_S = 0.05  # a hanging loop is noticed so much later than its limit at most


class Watchdog(Worker):
    """Calls ``watch`` every ``PERIOD_S`` in a ``with`` block; see ``Runtime.watch``.

    As a ``Subscriber`` it stops the robot when it has died itself.
    """

    def __init__(self, watch: Callable[[], None]) -> None:
        super().__init__("watchdog")
        self._watch = watch

    def on_tick(self, tick: Tick) -> None:  # noqa: ARG002  every turn is watched
        """HardwareError when nobody watches any more."""
        self.check()

    def _work(self) -> None:
        while not self._ending.wait(PERIOD_S):
            self._watch()
