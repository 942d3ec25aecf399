"""A mission is recorded from its start to its end and comes back as it was."""

from dataclasses import replace
from pathlib import Path

import pytest

from robot.errors import ConfigError
from robot.link.telemetry import MissionStatus, Telemetry
from tools.monitor.drives import DriveRecorder, list_drives, read_drive

PATH = ((0.0, 0.0), (1.0, 0.0))


def report(t_s: float, phase: str = "driving", mission: str = "m1", **fields: object) -> Telemetry:
    status = MissionStatus(mission, (1.0, 0.0), phase)
    return Telemetry("duck", "AUTO", mission=status, map="loop", t_sent_s=t_s, **fields)  # type: ignore[arg-type]


def record(folder: Path, reports: list[Telemetry]) -> list[bool]:
    recorder = DriveRecorder(folder, lambda: 1.7e9)
    return [recorder.take(one) for one in reports]


def test_a_drive_is_recorded_from_start_to_arrival(tmp_path: Path) -> None:
    still = Telemetry("duck", "READY")
    drive = [report(10.0 + 0.1 * i, path=PATH) for i in range(5)]
    done = record(tmp_path, [still, *drive, report(10.6, "arrived"), report(10.7, "arrived")])
    assert done == [False] * 6 + [True, False]
    (summary,) = list_drives(tmp_path)
    assert (summary.map, summary.phase) == ("loop", "arrived")
    assert summary.duration_s == pytest.approx(0.6)
    header, *reports = read_drive(tmp_path, summary.name)
    assert header["destination"] == [1.0, 0.0]
    assert [one["t_s"] for one in reports] == pytest.approx([0.0, 0.1, 0.2, 0.3, 0.4, 0.6])
    assert [len(one["path"]) for one in reports] == [2, 0, 0, 0, 0, 0]


def test_a_new_mission_begins_a_new_drive(tmp_path: Path) -> None:
    record(tmp_path, [report(1.0), report(2.0, mission="m2"), report(3.0, "stopped", "m2")])
    assert [drive.phase for drive in list_drives(tmp_path)] == ["stopped", "driving"]


def test_a_drive_that_was_cut_off_is_kept(tmp_path: Path) -> None:
    record(tmp_path, [report(1.0), report(2.0)])
    assert list_drives(tmp_path) == []
    DriveRecorder(tmp_path, lambda: 0.0)
    (summary,) = list_drives(tmp_path)
    path = tmp_path / f"{summary.name}.jsonl"
    path.write_text(path.read_text()[:-40])
    (again,) = list_drives(tmp_path)
    assert again.duration_s == 0.0
    assert len(read_drive(tmp_path, again.name)) == 2


def test_other_files_are_no_drives(tmp_path: Path) -> None:
    (tmp_path / "notes.jsonl").write_text("hello\n")
    (tmp_path / "empty.jsonl").write_text("")
    (tmp_path / "later.jsonl").write_text('{"schema": 2}\n')
    assert list_drives(tmp_path) == []


@pytest.mark.parametrize("name", ["../secret", "nothing", "", "a" * 200])
def test_only_drives_of_the_folder_can_be_read(tmp_path: Path, name: str) -> None:
    (tmp_path.parent / "secret.jsonl").write_text("{}\n")
    with pytest.raises(ConfigError, match="no drive"):
        read_drive(tmp_path, name)


def test_the_recording_is_the_report(tmp_path: Path) -> None:
    sent = replace(report(5.0), reason="ü", pose=(1.0, 2.0, 0.5), action=2, values=(0.1, 0.2))
    record(tmp_path, [sent, report(5.1, "failed")])
    _, first, _ = read_drive(tmp_path, list_drives(tmp_path)[0].name)
    assert (first["reason"], first["pose"], first["action"]) == ("ü", [1.0, 2.0, 0.5], 2)
