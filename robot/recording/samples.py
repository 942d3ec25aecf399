"""A drive as what was seen and how the wheels turned then, by whom; what of it is worth keeping.

A person marks good and bad pieces; what is bad is no sample, and is cut out.
"""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any, Iterator, List, NamedTuple, Optional, Sequence, Tuple

from robot.errors import ConfigError
from robot.geometry import WheelSpeeds
from robot.recording import topics
from robot.recording.reader import PathLike, copy, entries, read_note

MARKS = "marks"  # the metadata record that holds pieces
KINDS = ("good", "bad")
LATE_S = 0.3  # an older picture is not what was seen then
DRIVERS = {"AUTO": "policy", "MANUAL": "person"}  # by the robot's state


class Piece(NamedTuple):
    """A piece of a drive that a person marked; times since 1970 [s]."""

    from_s: float
    to_s: float
    kind: str  # one of KINDS


def read_pieces(path: PathLike) -> Tuple[Piece, ...]:
    """What is marked in a recording, by time; ConfigError for what is no marks."""
    try:
        plain = json.loads(read_note(path, MARKS).get("pieces", "[]"))
        pieces = tuple(Piece(float(a), float(b), str(kind)) for a, b, kind in plain)
    except (ValueError, TypeError) as error:
        raise ConfigError(f"{path}: expected marked pieces, got: {error}") from error
    return tuple(sorted(map(_checked, pieces)))


def mark(path: Path, pieces: Sequence[Piece]) -> None:
    """Put these marks into a recording, instead of its own; ConfigError for wrong ones."""
    plain = json.dumps(sorted(map(_checked, pieces)))
    copy(path, path, lambda *_: True, {MARKS: {"pieces": plain}})


def cut(path: Path, target: Path, wanted: Optional[Tuple[float, float]] = None) -> int:
    """Write what is worth keeping as a recording of its own; the number of its messages.

    That is what lies ``wanted`` seconds after the drive's beginning, or what is marked: the good
    pieces (all, without any), less the bad ones. The source stays as it is.
    """
    first = next(entries(path), None)
    pieces = read_pieces(path)
    if wanted is not None and first is not None:
        pieces = (Piece(first.time_s + wanted[0], first.time_s + wanted[1], "good"),)
    count = copy(path, target, lambda topic, time_s: kept(pieces, topic, time_s), {})
    if not count:
        target.unlink()
        raise ConfigError(f"{path}: expected something to keep, all of it is cut")
    return count


def kept(pieces: Sequence[Piece], topic: str, time_s: float) -> bool:
    """Whether these marks let a message stay; a picture is also kept for the turn that saw it."""
    if topic == topics.CAMERA.name and kept(pieces, "", time_s + LATE_S):
        return True
    good = [piece for piece in pieces if piece.kind == "good"]
    within = {piece.kind for piece in pieces if piece.from_s <= time_s < piece.to_s}
    return "bad" not in within and (not good or "good" in within)


def _checked(piece: Piece) -> Piece:
    if piece.kind not in KINDS or not -math.inf < piece.from_s < piece.to_s < math.inf:
        raise ConfigError(f"marks: expected good or bad from a time to a later one, got {piece}")
    return piece


class Sample(NamedTuple):
    """A turn in which the robot drove."""

    time_s: float  # since 1970
    picture: bytes  # PNG or JPEG, as it was recorded
    wheels: WheelSpeeds  # as told to the motors [m/s]
    driver: str  # policy or person


def read_samples(path: PathLike) -> Iterator[Sample]:
    """The turns in which the robot drove, less what is marked bad, each with what it saw.

    From the robot's own recording, else from the reports in a monitor's.
    """
    pieces, frame, own = read_pieces(path), None, False
    for entry in entries(path, topics.CAMERA, topics.TURN, topics.TELEMETRY):
        if entry.topic == topics.CAMERA.name:
            frame = entry
            continue
        own = own or entry.topic == topics.TURN.name
        if own != (entry.topic == topics.TURN.name) or frame is None:
            continue
        told: Any = entry.message()
        driver, wheels = DRIVERS.get(told.get("state")), told.get("wheels")
        late = entry.time_s - frame.time_s > LATE_S
        if driver and wheels and not late and kept(pieces, entry.topic, entry.time_s):
            image = topics.image_bytes(frame.message())
            yield Sample(entry.time_s, image, WheelSpeeds(*map(float, wheels)), driver)


def runs(samples: Sequence[Sample]) -> List[List[Sample]]:
    """Stretches without a gap: no turn in them comes later than twice the usual time."""
    gaps = [b.time_s - a.time_s for a, b in zip(samples, samples[1:])]
    most_s = 2.0 * sorted(gaps)[len(gaps) // 2] if gaps else math.inf
    found: List[List[Sample]] = []
    for sample, gap_s in zip(samples, [math.inf, *gaps]):
        if gap_s > most_s or not found:
            found.append([])
        found[-1].append(sample)
    return found


def take_overs(samples: Sequence[Sample]) -> int:
    """How often a person began to steer while the policy drove."""
    pairs = ((a.driver, b.driver) for run in runs(samples) for a, b in zip(run, run[1:]))
    return sum(pair == ("policy", "person") for pair in pairs)
