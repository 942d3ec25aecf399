"""A recording that was cut off anywhere gives what came before, and no error."""

from __future__ import annotations

from pathlib import Path
from typing import List, Tuple

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from robot.errors import ConfigError
from robot.recording import topics
from robot.recording.drive_file import DriveFile
from robot.recording.reader import (
    Entry,
    copy,
    entries,
    read_about,
    read_attachment,
    read_frames,
    read_turns,
    recover_folder,
)

ReadDataStream = pytest.importorskip("mcap.data_stream").ReadDataStream

FLUSHES, EACH = 6, 4


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Tuple[bytes, List[int], List[Entry]]:
    """A whole file, its size at each flush, and what is in it."""
    path = tmp_path_factory.mktemp("drives") / "a.mcap"
    file, rng, sizes = DriveFile(path, {"robot": "daisy"}), np.random.default_rng(0), []
    file.attach("model.onnx", rng.bytes(500), 0.0)
    for flush in range(FLUSHES):
        for number in range(EACH):
            picture = topics.image_message(flush, rng.bytes(300), "png")
            file.add(topics.CAMERA, float(flush), picture, number)
        sizes.append(file.flush())
    file.close()
    return path.read_bytes(), sizes, list(entries(path))


@settings(max_examples=60, deadline=None)
@given(share=st.floats(0.0, 1.0), junk=st.binary(max_size=40))
def test_a_cut_costs_only_what_lies_behind_it(
    recording: Tuple[bytes, List[int], List[Entry]],
    tmp_path_factory: pytest.TempPathFactory,
    share: float,
    junk: bytes,
) -> None:
    data, sizes, everything = recording
    cut = 8 + int(share * (len(data) - 8))
    path = tmp_path_factory.mktemp("cut") / "a.mcap"
    path.write_bytes(data[:cut] + junk)
    kept = list(entries(path))
    assert kept == everything[: len(kept)]
    assert len(kept) >= EACH * sum(size <= cut for size in sizes)
    assert copy(path, path.with_name("b.mcap"), lambda *_: True, {}) == len(kept)
    assert list(entries(path.with_name("b.mcap"))) == kept
    if cut > sizes[0]:
        assert read_about(path.with_name("b.mcap")) == {"robot": "daisy"}
        assert read_attachment(path.with_name("b.mcap"), "model.onnx") is not None


def test_a_flipped_bit_is_noticed(
    recording: Tuple[bytes, List[int], List[Entry]], tmp_path: Path
) -> None:
    data, sizes, everything = recording
    damaged = bytearray(data)
    damaged[(sizes[2] + sizes[3]) // 2] ^= 1
    (tmp_path / "a.mcap").write_bytes(damaged)
    assert list(entries(tmp_path / "a.mcap")) == everything[: 3 * EACH]


@pytest.mark.parametrize("data", [b"no recording at all", b"\x89PNG\r\n\x1a\n" + bytes(50)])
def test_other_files_are_refused(data: bytes, tmp_path: Path) -> None:
    (tmp_path / "a.mcap.partial").write_bytes(data)
    with pytest.raises(ConfigError, match="expected an MCAP recording"):
        list(entries(tmp_path / "a.mcap.partial"))
    assert list(recover_folder(tmp_path)) == []
    assert [path.name for path in tmp_path.iterdir()] == ["a.mcap.partial"]
    with pytest.raises(ConfigError, match="expected a recording"):
        read_about(tmp_path / "nothing.mcap")


def test_a_damaged_length_that_asks_for_all_memory_ends_the_recording(
    recording: Tuple[bytes, List[int], List[Entry]],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    data, _, everything = recording
    read, refused = ReadDataStream.read, []

    def on_a_small_computer(stream: ReadDataStream, length: int) -> bytes:
        if length > 1 << 28:
            refused.append(length)
            raise MemoryError
        return read(stream, length)

    monkeypatch.setattr(ReadDataStream, "read", on_a_small_computer)
    for at in range(8, 900):
        damaged = bytearray(data)
        damaged[at] ^= 0x80
        (tmp_path / "a.mcap").write_bytes(damaged)
        kept = list(entries(tmp_path / "a.mcap"))
        assert len(kept) <= len(everything)
    assert refused


def test_messages_of_another_robots_system_are_none_of_ours(tmp_path: Path) -> None:
    """ROS writes topics of the same names, in bytes of its own."""
    writer = pytest.importorskip("mcap.writer").Writer(str(tmp_path / "ros.mcap"))
    writer.start()
    for topic in (topics.POSE, topics.TURN, topics.CAMERA):
        schema = writer.register_schema("geometry_msgs/msg/Pose", "ros2msg", b"Point position")
        channel = writer.register_channel(topic.name, "cdr", schema)
        writer.add_message(channel, 1, b"\x00\x01\x00\x00\xff", 1)
    writer.finish()
    assert list(entries(tmp_path / "ros.mcap", topics.POSE, topics.TURN)) == []
    assert list(entries(tmp_path / "ros.mcap")) == []
    assert list(read_turns(tmp_path / "ros.mcap")) == []
    assert list(read_frames(tmp_path / "ros.mcap")) == []
