"""One moment for several processes: a small file in memory that all of them map.

Beside the time it counts what was sent on every stream, so that a receiver knows what must still
be on its way. Python 3.8: the robot's process reads it as well.
"""

from __future__ import annotations

import mmap
from pathlib import Path

OWN = ("telemetry", "frame", "command", "ack")  # of one robot and its monitor
OTHERS = "others' telemetry"
SLOTS = ("now", "pose", "lossy", "slow", "nan", *OWN)


class SharedTime:
    """Named numbers in a mapped file; ``create`` makes it, with zeros; ``second``: of that robot.

    ``now`` is the time [s]; of a stream it is the number of the newest message (`OTHERS`: that of
    the other robot); of commands and acks how many were sent; ``lossy`` is not zero while the
    network may lose or delay messages, and nobody should wait for one; ``slow`` is how long a
    decision takes [s], else no time; ``nan`` is not zero where it shall be none.
    """

    def __init__(self, path: str | Path, create: bool = False, second: bool = False) -> None:
        self._places = {name: place for place, name in enumerate(SLOTS)}
        own, its = (0, len(OWN)) if not second else (len(OWN), 0)
        self._places[OTHERS] = self._places["telemetry"] + its
        self._places.update((name, self._places[name] + own) for name in OWN)
        if create:
            Path(path).write_bytes(bytes(8 * (len(SLOTS) + len(OWN))))
        with open(path, "r+b") as file:
            self._numbers = memoryview(mmap.mmap(file.fileno(), 0)).cast("d")

    def get(self, slot: str) -> float:
        """The number in a slot."""
        return float(self._numbers[self._places[slot]])

    def set(self, slot: str, value: float) -> None:
        """Put a number into a slot; each has one writer."""
        self._numbers[self._places[slot]] = value

    def add(self, slot: str) -> None:
        """Count one more."""
        self.set(slot, self.get(slot) + 1.0)


def message_number(session: str, sequence: int) -> float:
    """28 bits of a session's hexadecimal name and 25 of the sequence: a double holds no more."""
    return float((int(session[:7], 16) << 25) + sequence)
