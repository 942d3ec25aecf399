"""Makes recordings whole that a kill or a power cut left without their end."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any, Dict, Iterator

from robot.errors import ConfigError
from robot.recording.drive_file import SUFFIX, UNFINISHED
from robot.recording.reader import PathLike, records


def recover_folder(folder: PathLike) -> Iterator[Path]:
    """Make every unfinished recording of a folder whole; where each lies then.

    Only for a folder that nobody else is recording into.

    Raises:
        OSError: the disk is full, or the folder may not be written.
    """
    for path in sorted(Path(folder).glob(f"*{UNFINISHED}")):
        whole = path.with_name(path.name[: -len(UNFINISHED)] + SUFFIX)
        try:
            recover(path, whole)
        except ConfigError:
            continue  # not ours, or not even a beginning
        path.unlink()
        yield whole


def recover(source: PathLike, target: PathLike) -> int:
    """Write what can be read of ``source`` as a whole recording; the number of its messages.

    Raises:
        ConfigError: the source is no recording.
        OSError: the disk is full.
    """
    from mcap.writer import Writer

    next(records(source), None)  # refuses another kind of file before anything is written
    hidden = Path(target).with_name(f".{Path(target).name}.tmp")
    with hidden.open("wb") as stream:
        writer = Writer(stream)
        writer.start(profile="", library="duckpilot")
        count = _copy(records(source), writer)
        writer.add_metadata("recovered", {"messages": str(count)})
        writer.finish()
        stream.flush()
        os.fsync(stream.fileno())
    os.replace(hidden, target)
    return count


def _copy(source: Iterator[Any], writer: Any) -> int:
    """Messages copied; everything else that is not an index goes along."""
    from mcap.records import Attachment, Channel, Message, Metadata, Schema

    schemas: Dict[int, int] = {}
    channels: Dict[int, int] = {}
    count = 0
    for record in source:
        if isinstance(record, Schema) and record.id not in schemas:
            schemas[record.id] = writer.register_schema(record.name, record.encoding, record.data)
        elif isinstance(record, Channel) and record.id not in channels:
            channels[record.id] = writer.register_channel(
                record.topic, record.message_encoding, schemas.get(record.schema_id, 0)
            )
        elif isinstance(record, Message) and record.channel_id in channels:
            channel = channels[record.channel_id]
            times = (record.log_time, record.data, record.publish_time, record.sequence)
            writer.add_message(channel, *times)
            count += 1
        elif isinstance(record, Metadata):
            writer.add_metadata(record.name, record.metadata)
        elif isinstance(record, Attachment):
            writer.add_attachment(
                *(record.create_time, record.log_time, record.name),
                *(record.media_type, record.data),
            )
    return count
