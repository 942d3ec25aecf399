"""Reads recordings, whole or cut off, and makes those whole that a kill or a power cut ended.

A person marks good and bad pieces of a drive; what is bad is no sample, and is cut out. Every
function raises ConfigError where there is no such file, or no MCAP.
"""

import fcntl
import json
import math
import struct
from pathlib import Path
from typing import Any, Callable, Dict, Iterator, List, NamedTuple, Optional, Sequence, Tuple, Union

import numpy as np

from robot.errors import ConfigError, ContractError
from robot.geometry import WheelSpeeds
from robot.output import atomically
from robot.recording import topics
from robot.recording.drive_file import ABOUT, MASK, SUFFIX, UNFINISHED, picture
from robot.recording.topics import Turn
from robot.typed_config import from_plain

RECORD_LIMIT_BYTES = 1 << 28  # a damaged length must not ask for all memory

PathLike = Union[str, Path]
MARKS = "marks"  # the metadata record that holds pieces
KINDS = ("good", "bad")
LATE_S = 0.3  # an older picture is not what was seen then
DRIVERS = {"AUTO": "policy", "MANUAL": "person"}  # by the robot's state


class Entry(NamedTuple):
    """One message: its topic, time since 1970 [s], its publisher's number, and JSON bytes."""

    topic: str
    time_s: float
    number: int
    data: bytes

    def message(self) -> Dict[str, Any]:
        """The message itself."""
        return dict(json.loads(self.data))


def records(path: PathLike) -> Iterator[Any]:
    """Every record (``mcap.records``) in the order of writing, up to the first damage."""
    from mcap.exceptions import McapError
    from mcap.stream_reader import StreamReader
    from mcap.writer import MCAP0_MAGIC
    from zstandard import ZstdError

    try:
        with Path(path).open("rb") as stream:
            begins = stream.read(len(MCAP0_MAGIC))
            if begins != MCAP0_MAGIC:
                told = f"a file that begins with {begins!r}" if begins else "an empty file"
                raise ConfigError(f"{path}: expected an MCAP recording, got {told}")
            stream.seek(0)
            reader = StreamReader(stream, validate_crcs=True, record_size_limit=RECORD_LIMIT_BYTES)
            try:
                yield from reader.records
            except (McapError, ZstdError, ValueError, struct.error, MemoryError, OverflowError):
                return  # cut off, or damaged from here on
    except OSError as error:
        raise ConfigError(f"{path}: expected a recording, got: {error.strerror}") from error


def entries(path: PathLike, *wanted: topics.Topic) -> Iterator[Entry]:
    """The messages on these topics (all without any), in the order of writing."""
    from mcap.records import Channel, Message

    names = {topic.name for topic in wanted}
    channels: Dict[int, str] = {}
    for record in records(path):
        if isinstance(record, Channel):
            channels[record.id] = record.topic if record.message_encoding == "json" else ""
        elif isinstance(record, Message):
            topic = channels.get(record.channel_id, "")
            if topic in names or (topic and not names):
                yield Entry(topic, record.log_time / topics.NS, record.sequence, record.data)


def read_about(path: PathLike, name: str = ABOUT) -> Dict[str, str]:
    """Facts under a name in a recording, robot, model and versions; {} where it has none."""
    from mcap.records import Metadata

    found = (r for r in records(path) if isinstance(r, Metadata) and r.name == name)
    return next((dict(record.metadata) for record in found), {})


def read_attachment(path: PathLike, name: str) -> Optional[bytes]:
    """A file inside a recording; None where it has none of this name."""
    from mcap.records import Attachment

    found = (r for r in records(path) if isinstance(r, Attachment) and r.name == name)
    return next((bytes(record.data) for record in found), None)


def read_frames(path: PathLike) -> Iterator[Tuple[float, np.ndarray]]:
    """What the camera saw: time since 1970 [s], frame (120, 160, 3) uint8 RGB without loss.

    ContractError: a frame that is no picture.
    """
    for entry in entries(path, topics.CAMERA):
        yield entry.time_s, _frame(entry)


def read_turns(path: PathLike) -> Iterator[Tuple[Turn, Optional[np.ndarray]]]:
    """Every turn with the frame that it saw; None where it saw none, or none was recorded.

    ContractError: a turn of another version, or a frame that is no picture.
    """
    frame: Optional[Entry] = None
    for entry in entries(path, topics.CAMERA, topics.TURN):
        if entry.topic == topics.CAMERA.name:
            frame = entry
            continue
        turn = turn_of(path, entry)
        seen = frame is not None and turn.frame is not None and frame.number == turn.frame & MASK
        yield turn, _frame(frame) if seen and frame is not None else None


def turn_of(path: PathLike, entry: Entry) -> Turn:
    """The turn in a message; ContractError for one of another version, or none."""
    try:
        return from_plain(Turn, entry.message())
    except (ValueError, TypeError, RecursionError) as error:
        raise ContractError(f"{path}: expected turns of this version, got: {error}") from error


def _frame(entry: Entry) -> np.ndarray:
    try:
        return picture(topics.image_bytes(entry.message()))
    except (ValueError, KeyError, TypeError, RecursionError) as error:
        raise ContractError(f"recorded frame {entry.number}: {error}") from error


def recover_folder(folder: PathLike) -> Iterator[Path]:
    """Make every unfinished recording of a folder whole; where each lies then.

    Nothing is done to one that is being recorded. OSError: the folder cannot be written to.
    """
    for path in sorted(Path(folder).glob(f"*{UNFINISHED}")):
        whole = path.with_name(path.name[: -len(UNFINISHED)] + SUFFIX)
        try:
            with path.open("r+b") as partial:
                fcntl.flock(partial, fcntl.LOCK_EX | fcntl.LOCK_NB)
                copy(path, whole, lambda *_: True, {"recovered": {}})
        except (ConfigError, BlockingIOError, FileNotFoundError, IsADirectoryError):
            continue  # not ours, not even a beginning, under way, or just completed
        path.unlink()
        yield whole


def copy(
    source: PathLike,
    target: PathLike,
    keeps: Callable[[str, float], bool],
    notes: Dict[str, Dict[str, str]],
) -> int:
    """Write a recording again, or over itself; the number of its messages.

    ``keeps`` says of a message's topic and time since 1970 [s] whether it stays; ``notes`` take
    the place of what has their names; everything else that is not an index goes along. OSError: the
    disk is full.
    """
    from mcap.records import Attachment, Channel, Footer, Message, Metadata, Schema
    from mcap.writer import Writer

    r: Any = next(records(source), None)  # refuses another kind of file before anything is written
    schemas: Dict[int, int] = {}
    channels: Dict[int, Tuple[int, str]] = {}
    count = 0
    with atomically(Path(target)) as hidden, hidden.open("wb") as stream:
        writer = Writer(stream)
        writer.start(profile="", library="duckpilot")
        for r in records(source):
            if isinstance(r, Schema) and r.id not in schemas:
                schemas[r.id] = writer.register_schema(r.name, r.encoding, r.data)
            elif isinstance(r, Channel) and r.id not in channels:
                schema = schemas.get(r.schema_id, 0)
                number = writer.register_channel(r.topic, r.message_encoding, schema)
                channels[r.id] = number, r.topic
            elif isinstance(r, Message) and r.channel_id in channels:
                number, topic = channels[r.channel_id]
                if keeps(topic, r.log_time / topics.NS):
                    writer.add_message(number, r.log_time, r.data, r.publish_time, r.sequence)
                    count += 1
            elif isinstance(r, Metadata) and r.name not in notes:
                writer.add_metadata(r.name, r.metadata)
            elif isinstance(r, Attachment):
                writer.add_attachment(r.create_time, r.log_time, r.name, r.media_type, r.data)
        for name, facts in notes.items():
            writer.add_metadata(name, facts or {"messages": str(count)})
        writer.finish()
        if source == target and not isinstance(r, Footer):  # what lies behind would be lost
            raise ConfigError(f"{source}: expected a whole recording, it is damaged; cut a new one")
    return count


class Piece(NamedTuple):
    """A piece of a drive that a person marked; times since 1970 [s]."""

    from_s: float
    to_s: float
    kind: str  # one of KINDS


def read_pieces(path: PathLike) -> Tuple[Piece, ...]:
    """What is marked in a recording, by time; ConfigError for what is no marks."""
    about = read_about(path, MARKS)
    try:
        plain = json.loads(about.get("pieces", "[]"))
        pieces = tuple(Piece(float(a), float(b), str(kind)) for a, b, kind in plain)
    except (ValueError, TypeError) as error:
        raise ConfigError(f"{path}: expected marked pieces, got: {error}") from error
    return tuple(sorted(map(_checked, pieces)))


def mark(path: Path, pieces: Sequence[Piece]) -> None:
    """Put these marks into a recording, instead of its own; ConfigError for wrong ones."""
    plain = json.dumps(sorted(map(_checked, pieces)))
    copy(path, path, lambda *_: True, {MARKS: {"pieces": plain}})


def cut(path: Path, target: Path) -> int:
    """Write what is worth keeping as a recording of its own; the number of its messages.

    That are the good pieces (all, without any), less the bad ones. The source stays as it is.
    """
    pieces = read_pieces(path)
    with atomically(target) as hidden:
        count = copy(path, hidden, lambda topic, time_s: kept(pieces, topic, time_s), {})
        if not count:
            raise ConfigError(f"{path}: expected something to keep, all of it is cut")
    return count


def kept(pieces: Sequence[Piece], topic: str, time_s: float) -> bool:
    """Whether these marks let a message stay; a picture is also kept for the turn that saw it."""
    if topic == topics.CAMERA.name and any(
        kept(pieces, "", time_s + s) for s in (0.1, 0.2, LATE_S)
    ):
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
        other = own != (entry.topic == topics.TURN.name)
        if other or frame is None or not kept(pieces, entry.topic, entry.time_s):
            continue
        try:
            sample = _sample(entry, frame)
        except (ValueError, KeyError, TypeError, RecursionError) as error:
            told = f"expected a turn and its picture, got: {error!r}"
            raise ContractError(f"{path}: {told}") from error
        if sample is not None:
            yield sample


def _sample(entry: Entry, frame: Entry) -> Optional[Sample]:
    told: Any = entry.message()
    driver, wheels = DRIVERS.get(told.get("state")), told.get("wheels")
    if not driver or not wheels or entry.time_s - frame.time_s > LATE_S:
        return None
    left_mps, right_mps = map(float, wheels)
    if not math.isfinite(left_mps + right_mps):
        raise ValueError(f"wheels {wheels}")
    image = topics.image_bytes(frame.message())
    return Sample(entry.time_s, image, WheelSpeeds(left_mps, right_mps), driver)


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
