"""What of a drive is worth keeping: marked pieces, and what is cut out by them."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import NamedTuple, Optional, Sequence, Tuple

from robot.errors import ConfigError
from robot.recording import topics
from robot.recording.reader import PathLike, copy, entries, read_note

MARKS = "marks"  # the metadata record that holds pieces
KINDS = ("good", "bad")
LATE_S = 0.3  # an older picture is not what was seen then


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
