"""One moment for several processes: a small file in memory that all of them map.

Beside the time it counts what was sent on every stream, so that a receiver knows what must still
be on its way. Python 3.8: the robot's process reads it as well.
"""

from __future__ import annotations

import mmap
from pathlib import Path

STREAMS = ("pose", "telemetry", "frame")
SESSIONS = tuple(f"{stream} session" for stream in STREAMS)
OWN = (*STREAMS[1:], *SESSIONS[1:], "command", "ack")  # of one robot and its monitor
EVERYBODYS = ("now", STREAMS[0], SESSIONS[0], "lossy", "slow", "nan")
SLOTS = (*EVERYBODYS, *OWN, *(f"{name} of the second" for name in OWN))


class SharedTime:
    """Named numbers in a mapped file; ``create`` makes it, with zeros; ``second``: of that robot.

    ``now`` is the time [s]; of a stream it is the sequence number of the newest message, and which
    session of the publisher that belongs to; of commands and acks how many were sent; ``lossy`` is
    not zero while the network may lose or delay messages, and nobody should wait for one; ``slow``
    is how long a decision takes [s], else no time; ``nan`` is not zero where it shall be none.
    """

    def __init__(self, path: str | Path, create: bool = False, second: bool = False) -> None:
        self._places = {name: SLOTS.index(name) for name in (*EVERYBODYS, *OWN)}
        for name in OWN if second else ():
            self._places[name] += len(OWN)
        if create:
            Path(path).write_bytes(bytes(8 * len(SLOTS)))
        with open(path, "r+b") as file:
            self._numbers = memoryview(mmap.mmap(file.fileno(), 0)).cast("d")

    def get(self, slot: str) -> float:
        """The number in a slot."""
        return float(self._numbers[self._places[slot]])

    def set(self, slot: str, value: float) -> None:
        """Put a number into a slot; each has one writer."""
        self._numbers[self._places[slot]] = value

    def now(self) -> float:
        """The time [s]."""
        return float(self._numbers[0])

    def publish(self, stream: str, session: str, sequence: int) -> None:
        """Note the newest message of a stream; its publisher is the one writer."""
        self.set(f"{stream} session", session_number(session))
        self.set(stream, sequence)

    def published(self, stream: str) -> tuple[float, float]:
        """Session, as a number, and sequence of the newest message of a stream."""
        return self.get(f"{stream} session"), self.get(stream)

    def add(self, slot: str) -> None:
        """Count one more."""
        self.set(slot, self.get(slot) + 1.0)


def session_number(session: str) -> float:
    """A session's hexadecimal name as a number; 48 bits of it, which a double holds exactly."""
    return float(int(session[:12], 16))
