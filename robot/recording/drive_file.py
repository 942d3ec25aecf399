"""``DriveFile``: one MCAP file while it is written.

Chunks are closed and handed to the disk at every ``flush``: whatever kills the program or the
power, all before the last flush stays readable (https://mcap.dev/spec).
"""

from __future__ import annotations

import json
import os
from contextlib import suppress
from pathlib import Path
from typing import Dict, Mapping

from robot.recording.topics import Json, Topic, to_ns

SUFFIX = ".mcap"
UNFINISHED = ".mcap.partial"
ABOUT = "duckpilot"  # the metadata record that says which robot, model and versions drove
END = "end"  # the one that says how the drive ended
CHUNK_BYTES = 1 << 20
MASK = 0xFFFFFFFF  # MCAP numbers messages in 32 bits


class DriveFile:
    """Writes ``PATH.mcap.partial``, which ``close`` completes and calls ``PATH.mcap``.

    Not for several threads.

    Args:
        path: with the suffix ``.mcap``; its folder is made.
        about: what does not change during the drive.

    Raises:
        OSError: from every method, when the disk does not take it.
    """

    def __init__(self, path: Path, about: Mapping[str, str]) -> None:
        from mcap.writer import Writer

        self.path = path
        self.partial = path.with_suffix(UNFINISHED)
        path.parent.mkdir(parents=True, exist_ok=True)
        self._stream = self.partial.open("xb")
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
        self._stream.close()
        os.replace(self.partial, self.path)
        return size

    def abandon(self) -> None:
        """Leave the file as it is on the disk: cut off, but readable up to there."""
        with suppress(OSError):  # what is still in Python's buffer may not fit
            self._stream.close()
