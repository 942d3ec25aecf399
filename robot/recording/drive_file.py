"""One recording while it is written: an MCAP file, and the turns of the loop as its messages.

Chunks are closed and handed to the disk at every ``flush``: whatever kills the program or the
power, all before the last flush stays readable (https://mcap.dev/spec).
"""

import fcntl
import json
import os
import platform
from contextlib import suppress
from pathlib import Path
from typing import Callable, Dict, Mapping, NamedTuple, Optional

import numpy as np

from robot.config import RobotConfig
from robot.geometry import Pose
from robot.link.messages import PoseMessage, Telemetry
from robot.link.wire import plain
from robot.parts import Tick
from robot.recording import topics
from robot.recording.topics import Json, Topic, Turn, to_ns
from robot.typed_config import to_plain

SUFFIX = ".mcap"
UNFINISHED = ".mcap.partial"
ABOUT = "duckpilot"  # the metadata record that says which robot, model and versions drove
END = "end"  # the one that says how the drive ended
CHUNK_BYTES = 1 << 20
MASK = 0xFFFFFFFF  # MCAP numbers messages in 32 bits
# Of zlib: a third smaller than raw, in a millisecond; the next levels gain 1 % for twice the time.
PNG_LEVEL = 1
MODEL, TRANSLATOR = "model.onnx", "translator.onnx"  # attachments of a recording


class DriveFile:
    """Writes ``PATH.mcap.partial``, which ``close`` completes and calls ``PATH.mcap``.

    Not for several threads. OSError: from every method, when the disk does not take it.
    """

    def __init__(self, path: Path, about: Mapping[str, str]) -> None:
        from mcap.writer import Writer

        self.path = path
        self.partial = path.with_suffix(UNFINISHED)
        path.parent.mkdir(parents=True, exist_ok=True)
        self._stream = self.partial.open("xb")
        fcntl.flock(self._stream, fcntl.LOCK_EX)  # as long as it lives: nobody else completes it
        self._writer = Writer(self._stream, chunk_size=CHUNK_BYTES)
        self._channels: Dict[str, int] = {}
        self._writer.start(profile="", library="duckpilot")
        self._writer.add_metadata(ABOUT, dict(about))

    def attach(self, name: str, data: bytes, time_s: float) -> None:
        """Put a whole file into the recording."""
        at = to_ns(time_s)
        self._writer.add_attachment(at, at, name, "application/octet-stream", data)

    def add(self, topic: Topic, time_s: float, message: Json, number: int = 0) -> None:
        """Add one message; ``time_s`` [s] since 1970, ``number`` of its publisher."""
        channel = self._channels.get(topic.name)
        if channel is None:
            schema = json.dumps({"title": topic.schema_name, **topic.schema}).encode()
            schema_id = self._writer.register_schema(topic.schema_name, "jsonschema", schema)
            channel = self._writer.register_channel(topic.name, "json", schema_id)
            self._channels[topic.name] = channel
        data = json.dumps(message, separators=(",", ":"), allow_nan=False).encode()
        at = to_ns(time_s)
        self._writer.add_message(channel, at, data, at, number & MASK)

    def flush(self, sync: bool = True) -> int:
        """Bring everything so far to the disk; the size of the file [bytes].

        Without ``sync`` only to the operating system: safe from a kill, not from a power cut.
        """
        self._writer.flush()
        if sync:
            os.fsync(self._stream.fileno())
        return self._stream.tell()

    def note(self, name: str, facts: Mapping[str, str]) -> None:
        """Add facts that are known only at the end."""
        self._writer.add_metadata(name, dict(facts))

    def close(self) -> int:
        """Complete the file and give it its name; its size [bytes]."""
        self._writer.finish()
        self._stream.flush()
        os.fsync(self._stream.fileno())
        size = self._stream.tell()
        os.replace(self.partial, self.path)
        self._stream.close()
        return size

    def abandon(self) -> None:
        """Leave the file as it is on the disk: cut off, but readable up to there."""
        with suppress(OSError):  # what is still in Python's buffer may not fit
            self._stream.close()


class Heard(NamedTuple):
    """One turn, with what its tick does not tell."""

    tick: Tick
    odometry: Optional[Pose] = None
    report: Optional[Telemetry] = None
    overhead: Optional[PoseMessage] = None  # the localizer's newest


class Subject(NamedTuple):
    """Who drives: facts for the head of a recording, models by their names there, and each turn."""

    about: Mapping[str, str]
    models: Mapping[str, Path]
    hear: Callable[[Tick], Heard] = Heard


def describe(config: RobotConfig, hear: Callable[[Tick], Heard] = Heard) -> Subject:
    """A configured robot. Its models' files are read again while the recording is written."""
    models = {MODEL: Path(config.model)}
    if config.translator:
        models[TRANSLATOR] = Path(config.translator)
    about = {
        "robot": config.name,
        "map": config.map,
        "model": Path(config.model).name,
        "max_wheel_mps": repr(config.safety.max_wheel_mps),
        "config": json.dumps(to_plain(config)),
        **arithmetic(),
    }
    return Subject(about, models, hear)


def arithmetic() -> Dict[str, str]:
    """What a policy's last bits depend on: processor, onnxruntime, and OpenCV, which resizes."""
    import cv2
    import onnxruntime

    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        lines = []
    told = ("model name", "CPU part")
    model = next((line.split(":", 1)[1].strip() for line in lines if line.startswith(told)), "")
    return {
        "machine": platform.machine(),
        "processor": model,
        "onnxruntime": onnxruntime.__version__,
        "opencv": cv2.__version__,
    }


class DriveLog:
    """Writes each turn into an open file; OSError from every method, as of `DriveFile`.

    ``wall_s`` added to the robot's clock is the time since 1970 [s]; ``models`` are the files that
    replay the drive, by their names in the recording.
    """

    def __init__(self, file: DriveFile, wall_s: float, models: Mapping[str, Path]) -> None:
        self.file = file
        self._wall_s = wall_s
        for name, path in models.items():
            file.attach(name, path.read_bytes(), path.stat().st_mtime)
        self.phase = ""  # of the mission; without one, the state that the robot is in
        self._frame: Optional[int] = None
        self._overhead: Optional[PoseMessage] = None

    def write(self, heard: Heard) -> None:
        """Add one turn."""
        tick, file = heard.tick, self.file
        time_s = tick.time_s + self._wall_s
        if tick.frame is not None and tick.frame.sequence != self._frame:
            self._frame = tick.frame.sequence
            taken_s = tick.frame.time_s + self._wall_s
            message = topics.image_message(taken_s, png(tick.frame.image), "png")
            file.add(topics.CAMERA, taken_s, message, tick.frame.sequence)
        file.add(topics.TURN, time_s, Turn.of(tick).plain(), tick.number)
        if tick.guidance is not None and tick.guidance.pose is not None:
            file.add(topics.POSE, time_s, topics.pose_message(time_s, tick.guidance.pose))
        if heard.odometry is not None:
            pose = topics.pose_message(time_s, heard.odometry, topics.WHEELS_FRAME)
            file.add(topics.ODOMETRY, time_s, pose)
        if heard.overhead is not None and heard.overhead is not self._overhead:
            self._overhead = heard.overhead
            pose = topics.overhead_message(time_s, heard.overhead)
            file.add(topics.OVERHEAD, time_s, pose, heard.overhead.sequence)
        self.phase = tick.verdict.state.value
        if heard.report is not None:
            file.add(topics.TELEMETRY, time_s, plain(heard.report))
            self.phase = heard.report.mission.phase if heard.report.mission else self.phase


def png(image: np.ndarray) -> bytes:
    """An RGB picture (H, W, 3) uint8, without loss."""
    import cv2

    options = [cv2.IMWRITE_PNG_COMPRESSION, PNG_LEVEL]
    return bytes(cv2.imencode(".png", image[..., ::-1], options)[1])


def picture(data: bytes) -> np.ndarray:
    """The RGB picture (H, W, 3) uint8 in PNG or JPEG bytes; ValueError for others."""
    import cv2

    found = None
    with suppress(cv2.error):  # of more pixels than it takes
        found = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR) if data else None
    if found is None:
        raise ValueError(f"expected a PNG or JPEG picture, got {len(data)} other bytes")
    return np.ascontiguousarray(found[..., ::-1])
