"""A drive as what was seen and how the wheels turned then, by whom."""

from __future__ import annotations

import math
from typing import Any, Iterator, List, NamedTuple, Optional, Sequence

from robot.geometry import WheelSpeeds
from robot.recording import topics
from robot.recording.pieces import LATE_S, kept, read_pieces
from robot.recording.reader import Entry, PathLike, entries

DRIVERS = {"AUTO": "policy", "MANUAL": "person"}  # by the robot's state


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
        sample = _sample(entry, frame)
        if sample is not None and kept(pieces, entry.topic, entry.time_s):
            yield sample


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


def _sample(entry: Entry, frame: Entry) -> Optional[Sample]:
    told: Any = entry.message()
    driver, wheels = DRIVERS.get(told.get("state")), told.get("wheels")
    if driver is None or not wheels or entry.time_s - frame.time_s > LATE_S:
        return None
    image = topics.image_bytes(frame.message())
    return Sample(entry.time_s, image, WheelSpeeds(*map(float, wheels)), driver)
