"""What a drive tells is in its file; what goes wrong with the file is no matter of the drive."""

from __future__ import annotations

import resource
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from robot.config import RecordingConfig
from robot.errors import ConfigError
from robot.recording.drive_file import MODEL, UNFINISHED
from robot.recording.reader import read_about, read_attachment, read_frames, read_turns
from robot.recording.recorder import LONGEST_S, QUEUE_TURNS, Recorder
from robot.recording.topics import Turn
from robot.safety.state_machine import Command
from robot.typed_config import from_plain
from tests.robot.recording.drives import WALL_S, Robot, record

pytest.importorskip("mcap")


def test_a_drive_comes_back_exactly(tmp_path: Path) -> None:
    robot = Robot(tmp_path / "robot")
    ticks = robot.drive(40)
    armed = ticks[3:]
    (path,) = record(robot, tmp_path / "drives", ticks)
    assert path.name.endswith("-daisy.mcap")
    read = list(read_turns(path))
    assert [turn for turn, _ in read] == [Turn.of(tick) for tick in armed]
    for (_, image), tick in zip(read, armed):
        assert tick.frame is not None
        assert np.array_equal(image, tick.frame.image)
    frames = list(read_frames(path))
    assert len(frames) == len(armed)
    assert frames[0][0] == pytest.approx(WALL_S - 0.02, abs=0.2)
    assert read_attachment(path, MODEL) == robot.model.read_bytes()
    assert read_about(path)["robot"] == "daisy"
    states = [turn.state for turn, _ in read]
    assert {"READY", "AUTO", "MANUAL", "HOLD"} == set(states)


def test_only_what_follows_arming_is_recorded(tmp_path: Path) -> None:
    robot = Robot(tmp_path / "robot")
    ticks = robot.turns(30)
    robot.ask(Command.ARM)
    ticks += robot.turns(5)
    robot.ask(Command.DISARM)
    ticks += robot.turns(60)  # six seconds, of which two are kept
    robot.ask(Command.ARM)
    ticks += robot.turns(4)
    first, second = record(robot, tmp_path / "drives", ticks)
    states = [turn.state for turn, _ in read_turns(first)]
    assert states[:5] == ["READY"] * 5
    assert set(states[5:]) == {"DISARMED"}
    assert 10 < len(states) < 40
    assert [turn.state for turn, _ in read_turns(second)] == ["READY"] * 4


def test_a_long_drive_has_several_files(tmp_path: Path) -> None:
    robot = Robot(tmp_path / "robot")
    robot.turn()
    robot.ask(Command.ARM)
    robot.ask(Command.AUTO)
    ticks = robot.turns(3)
    ticks += [replace(tick, time_s=tick.time_s + LONGEST_S) for tick in ticks]
    before = replace(ticks[3], time_s=ticks[3].time_s - 1.0)
    paths = record(robot, tmp_path / "drives", [*ticks[:3], before, *ticks[3:]])
    assert len(paths) == 2


def test_a_full_queue_loses_turns_and_holds_nobody_up(tmp_path: Path) -> None:
    robot = Robot(tmp_path / "robot")
    recorder = Recorder(RecordingConfig(str(tmp_path / "drives")), robot.subject())
    ticks = robot.drive(QUEUE_TURNS)  # nobody empties the queue: the thread was not started
    began_s = time.monotonic()
    for tick in ticks:
        recorder.on_tick(tick)
    assert time.monotonic() - began_s < 0.5
    assert recorder.dropped == len(ticks) - 3 - QUEUE_TURNS
    assert recorder.reading().level == "bad"


def await_level(recorder: Recorder, level: str) -> None:
    deadline_s = time.monotonic() + 10.0
    while recorder.reading().level != level:
        assert time.monotonic() < deadline_s
        time.sleep(0.01)


def test_a_disk_that_fills_up_ends_the_recording_only(tmp_path: Path) -> None:
    robot = Robot(tmp_path / "robot")
    with Recorder(RecordingConfig(str(tmp_path / "d"), 0.0), robot.subject()) as recorder:
        limits = resource.getrlimit(resource.RLIMIT_FSIZE)
        resource.setrlimit(resource.RLIMIT_FSIZE, (100_000, limits[1]))
        try:
            for tick in robot.drive(20):
                recorder.on_tick(tick)
                time.sleep(0.03)
            await_level(recorder, "bad")
            assert recorder.reading().name.startswith("not recording: File too")
        finally:
            resource.setrlimit(resource.RLIMIT_FSIZE, limits)
        (left,) = (tmp_path / "d").iterdir()
        assert left.name.endswith(UNFINISHED)
        list(read_turns(left))  # readable as far as it goes
        robot.turns(60)
        robot.ask(Command.ARM)  # the next drive tries again
        recorder.on_tick(robot.turn())
        await_level(recorder, "ok")
    assert len(list((tmp_path / "d").iterdir())) == 2


def test_room_that_the_system_needs_is_left_alone(tmp_path: Path) -> None:
    robot = Robot(tmp_path / "robot")
    recorder = Recorder(RecordingConfig(str(tmp_path / "drives"), 1e9), robot.subject())
    with recorder:
        for tick in robot.drive(3):
            recorder.on_tick(tick)
        await_level(recorder, "bad")
        assert recorder.reading().name == "not recording: disk full"
    assert list((tmp_path / "drives").iterdir()) == []


PATIENCE_S = 2.0  # for a disk and a processor that are busy with other tests

KILLED = """
import sys, time
from pathlib import Path
from tests.robot.recording.drives import *
robot = Robot(Path(sys.argv[1]) / "robot")
with Recorder(RecordingConfig(sys.argv[1] + "/drives", 0.0), robot.subject()) as recorder:
    robot.clock.now_s = time.monotonic()
    robot.runtime.step(); robot.ask(Command.ARM); robot.ask(Command.AUTO)
    while True:
        robot.clock.now_s = time.monotonic()
        recorder.on_tick(robot.runtime.step())
        print("turn", flush=True)
        time.sleep(0.05)
"""


def test_a_kill_costs_a_second_at_most(tmp_path: Path) -> None:
    command = [sys.executable, "-c", KILLED, str(tmp_path)]
    with subprocess.Popen(command, stdout=subprocess.PIPE) as process:
        assert process.stdout is not None
        process.stdout.readline()
        deadline_s = time.monotonic() + 60.0
        while not any(path.stat().st_size for path in (tmp_path / "drives").glob("*")):
            assert time.monotonic() < deadline_s, "it records nothing"
            time.sleep(0.1)
        time.sleep(2.0)
        killed_s = time.monotonic()
        process.send_signal(signal.SIGKILL)
    (cut,) = (tmp_path / "drives").iterdir()
    last_s = list(read_turns(cut))[-1][0].time_s
    assert 0.0 <= killed_s - last_s < 1.0 + PATIENCE_S
    # The next start makes it whole.
    robot = Robot(tmp_path / "robot")
    record(robot, tmp_path / "drives", robot.drive(2))
    whole = cut.with_suffix("")
    assert list(read_turns(whole))[-1][0].time_s == last_s
    assert not cut.exists()


def test_a_recording_section_needs_a_folder() -> None:
    with pytest.raises(ConfigError, match="leave the recording section out"):
        from_plain(RecordingConfig, {"folder": ""})
    with pytest.raises(ConfigError, match="keep_free_mb"):
        from_plain(RecordingConfig, {"folder": "x", "keep_free_mb": -1.0})
