"""When a recording is on the disk, whose it is while it grows, and when it begins and ends."""

from __future__ import annotations

import math
import os
import time
from collections import namedtuple
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import List, Tuple

import pytest

from robot.config import RecordingConfig
from robot.link.messages import MissionStatus, Telemetry
from robot.recording import topics
from robot.recording.drive_file import END, DriveFile, DriveLog, Heard
from robot.recording.reader import entries, read_about, read_frames, read_turns, recover_folder
from robot.recording.recorder import Recorder
from robot.safety.state_machine import Command
from tests.robot.recording.drives import WALL_S, Robot, record

pytest.importorskip("mcap")

PICTURE = topics.image_message(1.0, b"picture", "png")
Usage = namedtuple("Usage", "total used free")


@pytest.fixture
def synced(monkeypatch: pytest.MonkeyPatch) -> List[Tuple[int, List[str]]]:
    """At each fsync of a recording: how much of it was out of the program, and the names there."""
    calls, fsync = [], os.fsync

    def witness(descriptor: int) -> None:
        path = Path(os.readlink(f"/proc/self/fd/{descriptor}"))
        calls.append((os.fstat(descriptor).st_size, sorted(os.listdir(path.parent))))
        fsync(descriptor)

    monkeypatch.setattr("robot.recording.drive_file.os.fsync", witness)
    return calls


def test_flush_and_close_bring_everything_to_the_disk(
    tmp_path: Path, synced: List[Tuple[int, List[str]]]
) -> None:
    file = DriveFile(tmp_path / "a.mcap", {})
    file.add(topics.CAMERA, 1.0, PICTURE)
    assert synced == []
    size = file.flush()
    assert synced == [(size, ["a.mcap.partial"])]
    file.add(topics.CAMERA, 2.0, PICTURE)
    assert file.flush(sync=False) > size
    assert len(synced) == 1
    size = file.close()
    assert synced[1:] == [(size, ["a.mcap.partial"])], "before it has the name of a whole one"
    assert os.listdir(tmp_path) == ["a.mcap"]


@pytest.mark.parametrize("number", [math.nan, math.inf, -math.inf])
def test_a_number_that_json_has_no_word_for_is_refused(number: float, tmp_path: Path) -> None:
    file = DriveFile(tmp_path / "a.mcap", {})
    with pytest.raises(ValueError, match="JSON"):
        file.add(topics.CAMERA, 1.0, {"value": number})
    file.close()
    assert list(entries(tmp_path / "a.mcap")) == []


def test_a_drive_is_on_the_disk_while_it_lasts(
    tmp_path: Path, synced: List[Tuple[int, List[str]]], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("robot.recording.recorder.FLUSH_S", 0.0)
    robot = Robot(tmp_path / "robot")
    record(robot, tmp_path / "drives", robot.drive(5))
    assert len(synced) > 5


def test_a_drive_goes_to_the_disk_each_half_second_and_not_each_turn(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    now_s, flushed_s = [7.0], []
    write, flush = DriveLog.write, DriveFile.flush

    def slow(log: DriveLog, heard: Heard) -> None:
        write(log, heard)
        now_s[0] += 0.125

    def witness(file: DriveFile) -> int:
        flushed_s.append(now_s[0])
        return flush(file)

    monkeypatch.setattr(DriveLog, "write", slow)
    monkeypatch.setattr(DriveFile, "flush", witness)
    clock = SimpleNamespace(monotonic=lambda: now_s[0])
    monkeypatch.setattr("robot.recording.recorder.time", clock)
    robot = Robot(tmp_path / "robot")
    record(robot, tmp_path / "drives", robot.drive(13))  # 20 turns from arming to rest
    assert flushed_s == [7.5, 8.0, 8.5, 9.0, 9.5]


def test_a_drive_ends_its_recording_when_others_fill_the_disk(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("robot.recording.recorder.FLUSH_S", 0.0)
    free = iter([9e9, 9e9, 9e9])
    usage = lambda _: Usage(9e9, 0, next(free, 1e6))  # noqa: E731
    monkeypatch.setattr("robot.recording.recorder.shutil.disk_usage", usage)
    robot = Robot(tmp_path / "robot")
    with Recorder(RecordingConfig(str(tmp_path / "d"), 100.0), robot.subject()) as recorder:
        for tick in robot.drive(10):
            recorder.on_tick(tick)
    assert recorder.reading().name == "not recording: disk full"
    (left,) = (tmp_path / "d").iterdir()
    assert left.name.endswith(".partial")
    assert len(list(read_turns(left))) == 3


def test_what_is_being_recorded_is_nobody_elses(tmp_path: Path) -> None:
    file = DriveFile(tmp_path / "a.mcap", {})
    file.add(topics.CAMERA, 1.0, PICTURE)
    file.flush()
    assert list(recover_folder(tmp_path)) == []
    file.add(topics.CAMERA, 2.0, PICTURE)
    file.close()
    assert os.listdir(tmp_path) == ["a.mcap"]
    assert len(list(entries(tmp_path / "a.mcap"))) == 2
    DriveFile(tmp_path / "b.mcap", {}).abandon()
    with pytest.raises(FileExistsError):
        DriveFile(tmp_path / "b.mcap", {})


def test_a_clock_that_stood_still_costs_no_recording(tmp_path: Path) -> None:
    robot = Robot(tmp_path / "robot")
    (first,) = record(robot, tmp_path / "drives", robot.drive(2))
    junk = first.with_suffix(".mcap.partial")  # as of a robot that lost its power at once
    first.unlink()
    junk.write_bytes(b"")
    robot.turns(60)
    found = record(robot, tmp_path / "drives", robot.drive(2))
    assert {path.name for path in found} == {junk.name, f"{first.stem}-1.mcap"}
    assert junk.read_bytes() == b""


@pytest.mark.parametrize("number", [70_000, 2**32 + 5])
def test_a_picture_has_its_own_time_and_belongs_to_the_turn_that_saw_it(
    number: int, tmp_path: Path
) -> None:
    robot = Robot(tmp_path / "robot")
    tick = robot.turn()
    assert tick.frame is not None
    seen = replace(tick, frame=tick.frame._replace(sequence=number))
    blind = replace(tick, frame=tick.frame._replace(sequence=number + 1, time_s=0.0))
    file = DriveFile(tmp_path / "a.mcap", {})
    log = DriveLog(file, WALL_S, {})
    for each in (seen, seen):
        log.write(Heard(each))
    file.add(topics.TURN, WALL_S, topics.Turn.of(blind).plain())  # its picture was lost
    file.close()
    ((time_s, _),) = read_frames(file.path)
    assert time_s == pytest.approx(WALL_S + tick.frame.time_s, abs=1e-6)
    assert [image is not None for _, image in read_turns(file.path)] == [True, True, False]


def test_a_recording_tells_how_the_drive_ended(tmp_path: Path) -> None:
    robot = Robot(tmp_path / "robot")
    report = Telemetry("daisy", "HOLD", mission=MissionStatus("m", (1.0, 2.0), "arrived"))
    for told, phase in ((None, "HOLD"), (report, "arrived")):
        subject = robot.subject()._replace(hear=lambda t, told=told: Heard(t, report=told))
        folder = tmp_path / phase
        recorder = Recorder(RecordingConfig(str(folder), 0.0), subject, lambda: WALL_S)
        recorder.dropped = 3
        ticks = robot.drive(2)
        with recorder:
            for tick in ticks:
                recorder.on_tick(tick)
        (path,) = folder.iterdir()
        assert read_about(path, END) == {"dropped": "3", "phase": phase}
        robot.ask(Command.DISARM)
        robot.turns(60)


def test_a_robot_that_holds_is_recorded_for_two_seconds_more(tmp_path: Path) -> None:
    robot = Robot(tmp_path / "robot")
    ticks = robot.drive(5)
    armed_s = [tick.time_s for tick in ticks if tick.verdict.state.value != "HOLD"][-1]
    (path,) = record(robot, tmp_path / "drives", ticks + robot.turns(40))
    last, _ = list(read_turns(path))[-1]
    assert last.state == "HOLD"
    assert 1.75 < last.time_s - armed_s <= 2.0


def test_a_drive_that_is_over_is_a_whole_file_while_the_robot_stays_on(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("robot.recording.recorder.TAIL_S", 0.2)
    robot = Robot(tmp_path / "robot")
    with Recorder(RecordingConfig(str(tmp_path / "d"), 0.0), robot.subject()) as recorder:
        for tick in robot.drive(2):
            recorder.on_tick(tick)
        deadline_s = time.monotonic() + 20.0
        while not list((tmp_path / "d").glob("*.mcap")):
            assert time.monotonic() < deadline_s, "it waits for the end of the program"
            time.sleep(0.02)


def test_a_card_that_tidies_up_for_three_seconds_costs_no_turn(tmp_path: Path) -> None:
    robot = Robot(tmp_path / "robot")
    recorder = Recorder(RecordingConfig(str(tmp_path / "d")), robot.subject())
    for tick in robot.drive(30):  # nobody empties the queue: the thread was not started
        recorder.on_tick(tick)
    assert recorder.dropped == 0


def test_a_file_holds_ten_minutes_at_most(tmp_path: Path) -> None:
    robot = Robot(tmp_path / "robot")
    robot.turn()
    robot.ask(Command.ARM)
    tick = robot.turn()
    late = [replace(tick, time_s=tick.time_s + 0.5 * i) for i in range(1220)]
    parts = []
    recorder = Recorder(RecordingConfig(str(tmp_path / "d")), robot.subject())
    for each in late:
        recorder.on_tick(each)
        parts.append(recorder._waiting.popleft()[0])
    assert (parts.count(1), parts.count(2)) == (1201, 19)
