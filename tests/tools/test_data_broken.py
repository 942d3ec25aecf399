"""Recordings and datasets that are broken: one line, status 2, and nothing written."""

from __future__ import annotations

import json
import struct
import zlib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mcap.writer import Writer

from robot.recording import topics
from robot.recording.drive_file import png
from robot.recording.reader import Piece, mark, read_samples
from tests.tools.recorded import recorded
from tools.data.__main__ import main

AT_S = 1.7e9
GOOD = png(np.random.default_rng(0).integers(0, 255, (120, 160, 3), np.uint8))


def _chunk(kind: bytes, data: bytes) -> bytes:
    checksum = struct.pack(">I", zlib.crc32(kind + data))
    return struct.pack(">I", len(data)) + kind + data + checksum


HUGE = b"\x89PNG\r\n\x1a\n" + b"".join(
    _chunk(kind, data)
    for kind, data in (
        (b"IHDR", struct.pack(">IIBBBBB", 60_000, 60_000, 8, 2, 0, 0, 0)),
        (b"IDAT", b""),
        (b"IEND", b""),
    )
)
TURN: Any = {"state": "AUTO", "wheels": [0.1, 0.1]}
TURNS: list[Any] = [
    b"{nope",
    b"[1, 2]",
    {"state": ["AUTO"], "wheels": [0.1, 0.1]},
    *({"state": "AUTO", "wheels": w} for w in ([1, 2, 3], ["a", "b"], 5, [float("nan"), 0.1])),
]


def made(path: Path, camera: Any, turn: Any = TURN) -> Path:
    with path.open("wb") as stream:
        writer = Writer(stream)
        writer.start(profile="", library="another")
        for topic, message in ((topics.CAMERA, camera), (topics.TURN, turn)):
            data = message if isinstance(message, bytes) else json.dumps(message).encode()
            schema = writer.register_schema(topic.schema_name, "jsonschema", b"{}")
            channel = writer.register_channel(topic.name, "json", schema)
            writer.add_message(channel, int(AT_S * 1e9), data, int(AT_S * 1e9))
        writer.finish()
    return path


def seen(data: bytes) -> Any:
    return topics.image_message(AT_S, data, "png")


def refused(capsys: pytest.CaptureFixture[str], *words: str) -> str:
    assert main([*words]) == 2
    told = capsys.readouterr().err
    assert told.count("\n") == 1
    return told


@pytest.mark.parametrize("command", ["to-donkeycar", "to-lerobot"])
@pytest.mark.parametrize("data", [b"junk", b"", b"\xff\xd8junk", HUGE])
def test_a_picture_that_is_none(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], command: str, data: bytes
) -> None:
    pytest.importorskip("pyarrow")
    drive, out = made(tmp_path / "a.mcap", seen(data)), tmp_path / "out"
    told = refused(capsys, command, str(drive), "--out", str(out))
    assert "turn of 2023-11-1" in told
    assert "expected a PNG or JPEG picture" in told
    assert [*tmp_path.iterdir()] == [drive]


@pytest.mark.parametrize("turn", TURNS)
def test_a_turn_that_is_none(tmp_path: Path, capsys: pytest.CaptureFixture[str], turn: Any) -> None:
    drive = made(tmp_path / "a.mcap", seen(GOOD), turn)
    assert f"{drive}: expected a turn" in refused(capsys, "list", str(drive))


@pytest.mark.parametrize("camera", [b"{nope", {}])
def test_a_camera_message_that_is_none(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], camera: Any
) -> None:
    drive = made(tmp_path / "a.mcap", camera)
    assert f"{drive}: expected a turn" in refused(capsys, "list", str(drive))


@pytest.mark.parametrize("command", ["list", "plot", "cut"])
def test_an_mcap_file_of_something_else(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], command: str
) -> None:
    drive, out = tmp_path / "a.mcap", tmp_path / "out"
    with drive.open("wb") as stream:
        writer = Writer(stream)
        writer.start(profile="ros2", library="another")
        channel = writer.register_channel("/imu", "json", 0)
        writer.add_message(channel, 1, b"{}", 1)
        writer.finish()
    words = ["--out", str(out)] if command != "list" else []
    assert "got another MCAP file" in refused(capsys, command, str(drive), *words)
    assert not out.exists()


@pytest.mark.parametrize("command", ["plot", "cut"])
def test_results_go_into_a_new_folder(tmp_path: Path, command: str) -> None:
    drive, out = recorded(tmp_path, "a"), tmp_path / "new" / "folder" / "out.file"
    assert main([command, str(drive), "--out", str(out)]) == 0
    assert [*out.parent.iterdir()] == [out]


def test_a_plot_that_the_disk_does_not_take_leaves_the_old_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from matplotlib.figure import Figure

    def half(_: Figure, path: str, **__: object) -> None:
        Path(path).write_bytes(b"\x89PNG")
        raise OSError(28, "No space left on device")

    drive, out = recorded(tmp_path, "a"), tmp_path / "out.png"
    out.write_bytes(b"an older one")
    monkeypatch.setattr(Figure, "savefig", half)
    assert main(["plot", str(drive), "--out", str(out)]) == 1
    assert out.read_bytes() == b"an older one"


@pytest.mark.parametrize("broken", ["film", "info"])
def test_a_dataset_that_cannot_be_played(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], broken: str
) -> None:
    pytest.importorskip("pyarrow")
    drive, dataset = recorded(tmp_path, "a"), tmp_path / "dataset"
    assert main(["to-lerobot", str(drive), "--out", str(dataset)]) == 0
    capsys.readouterr()
    film = next(dataset.rglob("*.mp4"))
    if broken == "film":
        film.write_bytes(film.read_bytes()[:500])
    else:
        (dataset / "meta/info.json").write_text("[" * 200_000)
    told = refused(capsys, "from-lerobot", str(dataset), "--out", str(tmp_path / "back"))
    assert f"{dataset}: expected a whole LeRobot dataset" in told
    assert len(told) < 400


def test_a_broken_turn_that_is_marked_bad_is_left_out(tmp_path: Path) -> None:
    drive = made(tmp_path / "a.mcap", b"{nope", TURNS[-1])
    mark(drive, [Piece(AT_S - 1.0, AT_S + 1.0, "bad")])
    assert [*read_samples(drive)] == []
