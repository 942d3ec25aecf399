"""Who may make the robot move, when several operators are connected."""

from __future__ import annotations

import math
from typing import Hashable, Optional

HELD_S = 1.0  # a holder who is silent for longer no longer keeps others from it
# By then the robot has stopped for want of its holder, and whoever else is there may arm it.
FORGOTTEN_S = 2.0
MOVES = ("arm", "mission", "manual")
RELEASES = ("stop", "disarm")


class OperatorLock:
    """Who may make the robot move, when several operators are connected; for one thread.

    Whoever armed it has it, for as long as they are heard. Others may watch, and may always stop
    it; after that it is free. Times [s] are of the robot's clock.
    """

    def __init__(self) -> None:
        self._holder: Optional[Hashable] = None
        self._echo_s = -math.inf  # the newest time that anybody has shown to know
        self._holder_echo_s = -math.inf

    def heard(self, sender: Hashable, echo_s: float) -> None:
        """``sender`` has shown to know what the robot said at ``echo_s``."""
        self._echo_s = max(self._echo_s, echo_s)
        if sender == self._holder:
            self._holder_echo_s = max(self._holder_echo_s, echo_s)

    def problem(self, sender: Hashable, kind: str, now_s: float) -> str:
        """Why ``sender`` may not command this; "" when it may."""
        held = self._holder is not None and now_s - self._holder_echo_s <= HELD_S
        if kind not in MOVES or sender == self._holder or not held:
            return ""
        return "another operator has armed the robot; to take over, stop it, then arm it yourself"

    def done(self, sender: Hashable, kind: str, echo_s: float) -> None:
        """A command of ``sender``, who knew what the robot said at ``echo_s``, was done."""
        if kind in MOVES:
            self._holder, self._holder_echo_s = sender, echo_s
        elif kind in RELEASES:
            self._holder = None

    def age_s(self, now_s: float) -> float:
        """How long nobody was heard who counts: the holder, or anybody where there is none."""
        if self._holder is not None and now_s - self._holder_echo_s <= FORGOTTEN_S:
            return now_s - self._holder_echo_s
        return now_s - self._echo_s
