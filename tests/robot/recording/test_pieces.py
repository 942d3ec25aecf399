"""What of a drive is kept: marks, pieces cut out, and who drove."""

from __future__ import annotations

from pathlib import Path

import pytest

from robot.config import RecordingConfig
from robot.errors import ConfigError
from robot.geometry import WheelSpeeds
from robot.recording.reader import (
    Piece,
    cut,
    entries,
    kept,
    mark,
    read_about,
    read_attachment,
    read_frames,
    read_pieces,
    read_samples,
    runs,
    take_overs,
)
from robot.recording.recorder import Recorder
from robot.safety.state_machine import Command
from tests.robot.recording.drives import WALL_S, Robot


@pytest.fixture
def drive(tmp_path: Path) -> Path:
    """Ten turns by the policy, ten by hand, ten by the policy."""
    robot = Robot(tmp_path / "models")
    config = RecordingConfig(str(tmp_path / "drives"), 0.0)
    with Recorder(config, robot.subject(), lambda: WALL_S) as recorder:

        def turns(count: int) -> None:
            for _ in range(count):
                recorder.on_tick(robot.turn())

        turns(3)
        robot.ask(Command.ARM)
        robot.ask(Command.AUTO)
        turns(10)
        for _ in range(10):
            robot.ask(Command.MANUAL, WheelSpeeds(0.1, 0.2))
            turns(1)
        robot.ask(Command.AUTO)
        turns(10)
    (path,) = (tmp_path / "drives").iterdir()
    return path


def test_a_recording_tells_who_drove(drive: Path) -> None:
    samples = list(read_samples(drive))
    drivers = [sample.driver for sample in samples]
    assert drivers == ["policy"] * 10 + ["person"] * 10 + ["policy"] * 10
    assert take_overs(samples) == 1
    assert samples[15].wheels == pytest.approx((0.1, 0.2))
    assert len(runs(samples)) == 1
    assert len(runs(samples[:8] + samples[20:])) == 2


def test_marks_stay_in_the_recording_and_nothing_else_changes(drive: Path) -> None:
    before, about = list(entries(drive)), read_about(drive)
    samples = list(read_samples(drive))
    marks = [
        Piece(samples[12].time_s, samples[18].time_s, "bad"),
        Piece(samples[2].time_s, samples[25].time_s, "good"),
    ]
    for chosen in (marks[:1], marks):
        mark(drive, chosen)
        assert list(read_pieces(drive)) == sorted(chosen)
    assert list(entries(drive)) == before
    assert read_about(drive) == about
    assert read_attachment(drive, "model.onnx")
    kept = [*samples[2:12], *samples[18:25]]
    assert list(read_samples(drive)) == kept
    out = drive.with_name("cut.mcap")
    assert cut(drive, out) > 0
    assert list(read_samples(out)) == kept
    assert len(list(read_frames(out))) < 30
    assert list(entries(drive)) == before, "the source stays"
    mark(drive, [])
    assert list(read_samples(drive)) == samples


def test_wrong_marks_are_refused(drive: Path) -> None:
    for wrong in (
        Piece(2.0, 1.0, "good"),
        Piece(1.0, 2.0, "ugly"),
        Piece(1.0, float("nan"), "bad"),
    ):
        with pytest.raises(ConfigError, match="expected good or bad"):
            mark(drive, [wrong])
    mark(drive, [Piece(0.0, 1e12, "bad")])
    with pytest.raises(ConfigError, match="something to keep"):
        cut(drive, drive.with_name("none.mcap"))
    assert not drive.with_name("none.mcap").exists()
    (older := drive.with_name("older.mcap")).write_bytes(b"older")
    with pytest.raises(ConfigError, match="something to keep"):
        cut(drive, older)
    assert older.read_bytes() == b"older"
    mark(drive, [])


def test_marks_cost_a_damaged_recording_nothing(drive: Path) -> None:
    data = bytearray(drive.read_bytes())
    data[len(data) // 2] ^= 1
    drive.write_bytes(data)
    with pytest.raises(ConfigError, match="expected a whole recording, it is damaged"):
        mark(drive, [Piece(1.0, 2.0, "good")])
    assert drive.read_bytes() == data


def test_what_is_no_recording_is_told_once(tmp_path: Path) -> None:
    with pytest.raises(ConfigError) as told:
        read_pieces(tmp_path / "none.mcap")
    assert str(told.value).count("expected") == 1


def test_a_piece_lasts_from_its_first_moment_to_just_before_its_last() -> None:
    good, bad = Piece(5.0, 6.0, "good"), Piece(5.0, 6.0, "bad")
    for time_s, within in ((4.999, False), (5.0, True), (5.999, True), (6.0, False)):
        assert kept([good], "/turn", time_s) is within
        assert kept([bad], "/turn", time_s) is not within
    assert not kept([good, bad], "/turn", 5.5), "what is both is bad"


@pytest.mark.parametrize(
    "piece", [Piece(5.0, 5.2, "good"), Piece(5.0, 5.1, "good"), Piece(4.0, 4.95, "bad")]
)
def test_a_picture_stays_for_every_turn_that_may_have_seen_it(piece: Piece) -> None:
    """Whatever turn stays: one that lies between two pieces has what it saw, too."""
    pieces = [piece] if piece.kind == "good" else [piece, Piece(5.15, 9.0, "bad")]
    assert kept(pieces, "/turn", 5.0)
    assert all(kept(pieces, "/camera", 5.0 - age_s) for age_s in (0.0, 0.1, 0.2, 0.29))
    assert not kept(pieces, "/camera", 4.6)
