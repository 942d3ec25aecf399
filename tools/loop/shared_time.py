"""One moment for several processes: a small file in memory that all of them map.

Beside the time it counts what was sent on every stream, so that a receiver knows what must still
be on its way. Python 3.8: the robot's process reads it as well.
"""

from __future__ import annotations

import mmap
import struct
from pathlib import Path

SLOTS = ("now", "pose", "telemetry", "frame", "command", "ack", "lossy", "slow")
_NUMBER = struct.Struct("d")


class SharedTime:
    """Named numbers in a mapped file; ``create`` makes it, with zeros.

    ``now`` is the time [s]; of the streams it is how many messages were sent; ``lossy`` is not zero
    while the network may lose or delay messages, and nobody should wait for one; ``slow`` is how
    long a decision takes [s], which is no time at all otherwise.
    """

    def __init__(self, path: str | Path, create: bool = False) -> None:
        size = _NUMBER.size * len(SLOTS)
        if create:
            Path(path).write_bytes(bytes(size))
        with open(path, "r+b") as file:
            self._map = mmap.mmap(file.fileno(), size)

    def get(self, slot: str) -> float:
        """The number in a slot."""
        return float(_NUMBER.unpack_from(self._map, _NUMBER.size * SLOTS.index(slot))[0])

    def set(self, slot: str, value: float) -> None:
        """Put a number into a slot; each has one writer."""
        _NUMBER.pack_into(self._map, _NUMBER.size * SLOTS.index(slot), value)

    def now(self) -> float:
        """The time [s]."""
        return float(_NUMBER.unpack_from(self._map, 0)[0])

    def add(self, slot: str) -> None:
        """Count one more."""
        self.set(slot, self.get(slot) + 1.0)
