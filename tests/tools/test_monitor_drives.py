"""A mission is recorded from its start to its end and comes back as it was, pictures and all."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from mcap.writer import Writer

from robot.errors import ConfigError
from robot.link.messages import FrameMessage, MissionStatus, Telemetry
from robot.recording import topics
from robot.recording.drive_file import DriveFile, Heard, picture
from robot.recording.reader import Piece, read_samples
from robot.safety.state_machine import Command
from tests.robot.recording.drives import Robot, record
from tools.monitor.drives import (
    DriveRecorder,
    list_drives,
    read_drive,
    read_marks,
    read_picture,
    write_marks,
)

PATH = ((0.0, 0.0), (1.0, 0.0))


def report(t_s: float, phase: str = "driving", mission: str = "m1", **fields: object) -> Telemetry:
    status = MissionStatus(mission, (1.0, 0.0), phase)
    return Telemetry("duck", "AUTO", mission=status, map="loop", t_sent_s=t_s, **fields)  # type: ignore[arg-type]


def jpeg(number: int) -> bytes:
    return b"\xff\xd8" + bytes([number]) * 50 + b"\xff\xd9"


def take(folder: Path, reports: list[Telemetry]) -> list[bool]:
    recorder = DriveRecorder(folder, lambda: 1.7e9)
    return [recorder.take(one) for one in reports]


def test_a_drive_is_recorded_from_start_to_arrival(tmp_path: Path) -> None:
    still = Telemetry("duck", "READY")
    drive = [report(10.0 + 0.1 * i, path=PATH) for i in range(5)]
    done = take(tmp_path, [still, *drive, report(10.6, "arrived"), report(10.7, "arrived")])
    assert done == [False] * 6 + [True, False]
    (summary,) = list_drives(tmp_path)
    assert (summary.map, summary.phase) == ("loop", "arrived")
    assert summary.duration_s == pytest.approx(0.6)
    reports = read_drive(tmp_path, summary.name)
    assert reports[0]["mission"]["destination"] == [1.0, 0.0]
    assert [one["t_s"] for one in reports] == pytest.approx([0.0, 0.1, 0.2, 0.3, 0.4, 0.6])
    assert [len(one["path"]) for one in reports] == [2, 0, 0, 0, 0, 0]


def test_the_disk_is_asked_twice_a_second_and_never_waited_for(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A slow one must not hold up a STOP."""
    flushes: list[bool] = []
    monkeypatch.setattr(DriveFile, "flush", lambda _, sync=True: flushes.append(sync))
    take(tmp_path, [report(10.0 + 0.1 * i) for i in range(21)])
    assert flushes == [False] * 4


def test_pictures_come_back_at_their_time(tmp_path: Path) -> None:
    recorder = DriveRecorder(tmp_path, lambda: 1.7e9)
    recorder.take_frame(FrameMessage(jpeg(0), 9.9))  # before the drive
    for i in range(30):
        recorder.take(report(10.0 + 0.1 * i))
        recorder.take_frame(FrameMessage(jpeg(i), 10.02 + 0.1 * i, sequence=i))
    recorder.take(report(15.0, "arrived"))
    name = list_drives(tmp_path)[0].name
    assert read_picture(tmp_path, name, 0.0) is None  # none yet
    assert read_picture(tmp_path, name, 0.03) == (jpeg(0), "image/jpeg")
    assert read_picture(tmp_path, name, 2.0) == (jpeg(19), "image/jpeg")
    assert read_picture(tmp_path, name, 4.0) == (jpeg(29), "image/jpeg")
    assert read_picture(tmp_path, name, 9.0) is None  # long gone
    assert read_picture(tmp_path, name, -1e9) is None


def test_the_robots_own_recordings_are_drives_too(tmp_path: Path) -> None:
    robot = Robot(tmp_path / "robot")
    robot.turn()
    robot.ask(Command.ARM)
    ticks = robot.turns(5)
    telemetry = iter([Telemetry("daisy", "READY", t_sent_s=float(i)) for i in range(9)])
    subject = robot.subject()._replace(hear=lambda tick: Heard(tick, report=next(telemetry)))
    robot.subject = lambda: subject  # type: ignore[method-assign]
    record(robot, tmp_path / "drives", ticks)
    (summary,) = list_drives(tmp_path / "drives")
    assert summary.phase == "READY"
    assert len(read_drive(tmp_path / "drives", summary.name)) == 5
    found = read_picture(tmp_path / "drives", summary.name, 0.0)
    assert found is not None
    assert ticks[0].frame is not None
    assert np.array_equal(picture(found[0]), ticks[0].frame.image)


def test_a_new_mission_begins_a_new_drive(tmp_path: Path) -> None:
    take(tmp_path, [report(1.0), report(2.0, mission="m2"), report(3.0, "stopped", "m2")])
    assert [drive.phase for drive in list_drives(tmp_path)] == ["stopped", "stopped"]


def test_a_robot_that_boots_anew_in_a_drive_begins_another_recording(tmp_path: Path) -> None:
    """Its clock does, too: a drive of seconds had lasted for two hours, backwards."""
    recorder = DriveRecorder(tmp_path, iter((1.7e9, 1.7e9 + 60.0)).__next__)
    reports = report(7200.0), report(7200.1), report(20.0), report(20.1, "stopped")
    assert [recorder.take(one) for one in reports] == [False, False, True, True]
    first, second = list_drives(tmp_path)
    for each in (first, second):
        assert each.duration_s == pytest.approx(0.1)
        assert read_drive(tmp_path, each.name)[0]["t_s"] == 0.0


def by_hand(t_s: float, **fields: object) -> Telemetry:
    return replace(report(t_s, "stopped"), state="MANUAL", **fields)  # type: ignore[arg-type]


def test_a_person_who_takes_over_and_hands_over_is_in_one_drive(tmp_path: Path) -> None:
    drive = [report(1.0), report(1.1), by_hand(1.2), by_hand(1.3), report(1.4, mission="m2")]
    done = take(tmp_path, [*drive, report(1.5, "arrived", "m2")])
    assert done == [False] * 5 + [True]
    (summary,) = list_drives(tmp_path)
    assert summary.phase == "arrived"
    assert len(read_drive(tmp_path, summary.name)) == 6


def test_a_drive_by_hand_is_recorded_with_its_wheels(tmp_path: Path) -> None:
    recorder = DriveRecorder(tmp_path, lambda: 1.7e9)
    assert not recorder.take(Telemetry("duck", "READY"))
    for i in range(10):
        driving = Telemetry("duck", "MANUAL", wheels=(0.1, 0.2), t_sent_s=5.0 + 0.1 * i)
        recorder.take_frame(FrameMessage(jpeg(i), 4.98 + 0.1 * i, sequence=i))
        assert not recorder.take(driving)
    assert recorder.take(Telemetry("duck", "HOLD", wheels=(0.0, 0.0), t_sent_s=6.0))
    (summary,) = list_drives(tmp_path)
    assert summary.phase == "by hand"
    samples = list(read_samples(tmp_path / f"{summary.name}.mcap"))
    assert [sample.picture for sample in samples] == [jpeg(i) for i in range(1, 10)]
    assert {sample.wheels for sample in samples} == {(0.1, 0.2)}
    assert {sample.driver for sample in samples} == {"person"}


def test_a_drive_by_hand_after_a_mission_is_none_of_its_drives(tmp_path: Path) -> None:
    take(tmp_path, [by_hand(1.0), by_hand(1.1), replace(report(1.2, "arrived"), state="HOLD")])
    assert [drive.phase for drive in list_drives(tmp_path)] == ["by hand"]


def test_marks_are_seconds_since_the_first_report(tmp_path: Path) -> None:
    take(tmp_path, [*(report(10.0 + 0.1 * i) for i in range(50)), report(15.0, "arrived")])
    name = list_drives(tmp_path)[0].name
    before = read_drive(tmp_path, name)
    assert read_marks(tmp_path, name) == []
    write_marks(tmp_path, name, [Piece(1.0, 2.0, "bad"), Piece(0.0, 4.0, "good")])
    good, bad = read_marks(tmp_path, name)
    assert good == pytest.approx((0.0, 4.0, "good"))
    assert bad == pytest.approx((1.0, 2.0, "bad"))
    assert read_drive(tmp_path, name) == before
    with pytest.raises(ConfigError, match="drive: unknown"):
        write_marks(tmp_path, "../secret", [])


def test_two_drives_by_hand_within_a_second_are_two(tmp_path: Path) -> None:
    wall = iter((1.7e9, 1.7e9 + 0.4))
    recorder = DriveRecorder(tmp_path, lambda: next(wall))
    for t_s in (5.0, 5.2, 5.4, 5.6):
        state = "MANUAL" if t_s in (5.0, 5.4) else "HOLD"
        recorder.take(Telemetry("duck", state, t_sent_s=t_s))
    assert len(list_drives(tmp_path)) == 2


def test_a_second_monitor_leaves_a_drive_that_is_being_recorded(tmp_path: Path) -> None:
    recorder = DriveRecorder(tmp_path, lambda: 1.7e9)
    for i in range(20):
        recorder.take(report(10.0 + 0.1 * i))
    DriveRecorder(tmp_path, lambda: 1.7e9)
    for i in range(20, 40):
        recorder.take(report(10.0 + 0.1 * i))
    assert recorder.take(report(14.0, "arrived"))
    (summary,) = list_drives(tmp_path)
    assert len(read_drive(tmp_path, summary.name)) == 41


def test_a_drive_that_was_cut_off_is_kept(tmp_path: Path) -> None:
    take(tmp_path, [report(1.0), report(2.0), report(2.1)])
    assert list_drives(tmp_path) == []
    DriveRecorder(tmp_path, lambda: 0.0)
    (summary,) = list_drives(tmp_path)
    assert len(read_drive(tmp_path, summary.name)) == 2


def test_a_folder_or_a_file_that_is_gone_keeps_no_drive_from_being_recovered(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "a.mcap.partial").mkdir()
    take(tmp_path, [report(1.0), report(2.0), report(2.1)])
    found = [tmp_path / "0.mcap.partial", *tmp_path.glob("*.partial")]
    monkeypatch.setattr(Path, "glob", lambda *_: iter(found))
    DriveRecorder(tmp_path, lambda: 0.0)
    monkeypatch.undo()
    assert len(list_drives(tmp_path)) == 1


def test_other_files_are_no_drives(tmp_path: Path) -> None:
    (tmp_path / "notes.mcap").write_text("hello\n")
    (tmp_path / "empty.mcap").write_text("")
    (tmp_path / "folder.mcap").mkdir()
    assert list_drives(tmp_path) == []


def test_the_newest_drive_is_first(tmp_path: Path) -> None:
    wall = iter((1.7e9, 1.7e9 + 0.4, 1.7e9 + 60.0))
    recorder = DriveRecorder(tmp_path, lambda: next(wall))
    for t_s in (1.0, 2.0, 3.0):
        recorder.take(report(t_s))
        recorder.take(report(t_s + 0.1, "stopped"))
    names = [drive.name for drive in list_drives(tmp_path)]
    assert len(names) == 3
    assert names == sorted(names, reverse=True)


@pytest.mark.parametrize("told", [b"null", b"[" * 100_000, b'{"path": ', b'{"state": "AUTO"}'])
def test_a_drive_whose_reports_are_none_is_told_as_damaged(tmp_path: Path, told: bytes) -> None:
    with (tmp_path / "odd.mcap").open("wb") as stream:
        writer = Writer(stream)
        writer.start()
        channel = writer.register_channel(topics.TELEMETRY.name, "json", schema_id=0)
        writer.add_message(channel, 1, told, 1)
        writer.finish()
    with pytest.raises(ConfigError, match=r"odd\.mcap: a damaged drive"):
        read_drive(tmp_path, "odd")


@pytest.mark.parametrize("name", ["../secret", "nothing", "", "a" * 200])
def test_only_drives_of_the_folder_can_be_read(tmp_path: Path, name: str) -> None:
    (tmp_path.parent / "secret.mcap").write_text("{}\n")
    with pytest.raises(ConfigError, match="drive: unknown"):
        read_drive(tmp_path, name)


def test_the_recording_is_the_report(tmp_path: Path) -> None:
    sent = replace(report(5.0), reason="ü", pose=(1.0, 2.0, 0.5), action=2, values=(0.1, 0.2))
    take(tmp_path, [sent, report(5.1, "failed")])
    first, _ = read_drive(tmp_path, list_drives(tmp_path)[0].name)
    assert (first["reason"], first["pose"], first["action"]) == ("ü", [1.0, 2.0, 0.5], 2)
