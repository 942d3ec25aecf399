"""A recording is what Foxglove opens: a whole MCAP, with the well-known schemas kept.

`WELL_KNOWN` is from https://github.com/foxglove/foxglove-sdk/tree/main/schemas/jsonschema.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any, Dict, List

import pytest

from robot.geometry import Pose
from robot.link.messages import PoseMessage, Telemetry
from robot.recording import topics
from robot.recording.drive_file import UNFINISHED, Heard
from robot.recording.reader import entries, recover_folder
from tests.robot.recording.drives import Robot, record

pytest.importorskip("mcap")

TIME = {"sec": "integer", "nsec": "integer"}
VECTOR = dict.fromkeys("xyz", "number")
POSE = {"position": VECTOR, "orientation": {**VECTOR, "w": "number"}}
STAMPED = {"timestamp": TIME, "frame_id": "string"}
WELL_KNOWN: Dict[str, Dict[str, Any]] = {
    "foxglove.CompressedImage": {**STAMPED, "data": "base64", "format": "string"},
    "foxglove.PoseInFrame": {**STAMPED, "pose": POSE},
}
IMAGE_FORMATS = ("jpeg", "png", "webp", "avif")
PARSED_TYPES = ("object", "array", "string", "number", "integer", "boolean")


@pytest.fixture
def recording(tmp_path: Path) -> Path:
    robot = Robot(tmp_path / "robot")
    seen = PoseMessage("daisy", 1.1, 2.1, None, 0.9, 5.0)
    report = Telemetry("daisy", "AUTO", "auto, by a person", 2, path=((0.0, 0.0), (1.0, 2.0)))
    odometry = Pose(0.5, 0.0, -0.5)
    subject = robot.subject()._replace(hear=lambda t: Heard(t, odometry, report, seen))
    robot.subject = lambda: subject  # type: ignore[method-assign]
    (path,) = record(robot, tmp_path / "drives", robot.drive(25))
    return path


def test_the_file_is_whole(recording: Path) -> None:
    _expect_whole(recording)


def test_a_file_that_was_cut_off_is_whole_again(recording: Path) -> None:
    data = recording.read_bytes()
    recording.unlink()
    cut = recording.with_suffix(UNFINISHED)
    cut.write_bytes(data[: len(data) * 2 // 3])
    (mended,) = recover_folder(recording.parent)
    assert not cut.exists()
    _expect_whole(mended)


def _expect_whole(path: Path) -> None:
    """Every checksum, index and statistic agrees with what lies between them."""
    from mcap.reader import make_reader

    with path.open("rb") as stream:
        reader = make_reader(stream, validate_crcs=True)
        summary = reader.get_summary()
        assert summary is not None
        assert summary.statistics is not None
        assert summary.chunk_indexes, "readable by time without reading it all"
        counts: Dict[int, int] = {}
        times: List[int] = []
        for schema, channel, message in reader.iter_messages():
            assert schema is not None
            assert (channel.message_encoding, schema.encoding) == ("json", "jsonschema")
            counts[channel.id] = counts.get(channel.id, 0) + 1
            times.append(message.log_time)
        statistics = summary.statistics
        assert counts == statistics.channel_message_counts
        span = (statistics.message_start_time, statistics.message_end_time)
        assert (min(times), max(times)) == span
        assert statistics.attachment_count == len(summary.attachment_indexes) == 1
        assert {schema.name for schema in summary.schemas.values()} >= set(WELL_KNOWN)


def test_messages_keep_the_well_known_schemas(recording: Path) -> None:
    known = {t.name: WELL_KNOWN[t.schema_name] for t in vars(topics).values() if _well_known(t)}
    assert len(known) == 4
    met = set()
    for entry in entries(recording):
        if entry.topic in known:
            met.add(entry.topic)
            _expect(known[entry.topic], entry.message(), entry.topic)
            stamp = entry.message()["timestamp"]
            assert stamp["sec"] + stamp["nsec"] * 1e-9 == pytest.approx(entry.time_s, abs=1e-6)
    assert met == set(known)


def test_schemas_promise_what_is_well_known_in_types_that_are_parsed() -> None:
    for topic in vars(topics).values():
        if isinstance(topic, topics.Topic):
            _expect_parsed(topic.schema, topic.name)
        if _well_known(topic):
            _expect_promised(WELL_KNOWN[topic.schema_name], topic.schema, topic.name)


def test_every_message_fits_the_schema_that_lies_beside_it(recording: Path) -> None:
    jsonschema = pytest.importorskip("jsonschema")
    from mcap.reader import make_reader

    with recording.open("rb") as stream:
        for schema, _, message in make_reader(stream).iter_messages():
            assert schema is not None
            jsonschema.validate(_without_nulls(json.loads(message.data)), json.loads(schema.data))


def test_places_and_pictures_are_as_they_were(recording: Path) -> None:
    found = {entry.topic: entry.message() for entry in entries(recording)}
    assert found["/pose"]["pose"]["position"] == {"x": 1.0, "y": 2.0, "z": 0.0}
    assert found["/camera"]["format"] in IMAGE_FORMATS
    assert [entry.topic for entry in entries(recording)].count("/overhead") == 1
    turned = topics.pose_message(0.0, Pose(0.0, 0.0, 3.0))["pose"]["orientation"]
    assert sum(value**2 for value in turned.values()) == pytest.approx(1.0), "a unit quaternion"


def _well_known(topic: Any) -> bool:
    return isinstance(topic, topics.Topic) and topic.schema_name in WELL_KNOWN


def _expect(wanted: Any, got: Any, where: str) -> None:
    """The required fields are there, of the right types."""
    if isinstance(wanted, dict):
        for name, kind in wanted.items():
            assert name in got, f"{where}: no {name}"
            _expect(kind, got[name], f"{where}.{name}")
    elif isinstance(wanted, list):
        for item in got:
            _expect(wanted[0], item, where)
    else:
        kinds: Dict[str, Any] = {"integer": int, "number": (int, float)}
        assert isinstance(got, kinds.get(wanted, str)), where
        assert not isinstance(got, bool), where
        if where.endswith("nsec"):
            assert 0 <= got < 10**9


def _expect_promised(wanted: Any, schema: Dict[str, Any], where: str) -> None:
    if isinstance(wanted, dict):
        assert schema["type"] == "object", where
        assert set(wanted) <= set(schema["required"]), where
        for name, kind in wanted.items():
            _expect_promised(kind, schema["properties"][name], f"{where}.{name}")
    elif isinstance(wanted, list):
        assert schema["type"] == "array", where
        _expect_promised(wanted[0], schema["items"], where)
    elif wanted == "base64":
        assert (schema["type"], schema["contentEncoding"]) == ("string", "base64"), where
    else:
        assert schema["type"] == wanted, where


def _expect_parsed(schema: Dict[str, Any], where: str) -> None:
    """Foxglove's parser knows one type for each field, and no unions."""
    assert schema["type"] in PARSED_TYPES, where
    for name, kind in schema.get("properties", {}).items():
        _expect_parsed(kind, f"{where}.{name}")
    if schema["type"] == "array":
        _expect_parsed(schema["items"], where)


def _without_nulls(message: Any) -> Any:
    if isinstance(message, dict):
        return {name: _without_nulls(v) for name, v in message.items() if v is not None}
    return [_without_nulls(v) for v in message] if isinstance(message, list) else message
