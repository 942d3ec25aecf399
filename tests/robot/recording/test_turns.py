"""What a turn tells in a recording, and what replay and samples make of it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import List, Sequence

import numpy as np
import pytest

from robot.geometry import WheelSpeeds
from robot.link.messages import Telemetry
from robot.parts import Tick
from robot.recording import replay as module
from robot.recording import topics
from robot.recording.drive_file import MODEL, DriveFile, DriveLog, Heard
from robot.recording.reader import Sample, read_samples, runs, take_overs
from robot.recording.replay import replay
from robot.recording.topics import Turn
from robot.safety.gates import Inputs, Reason
from robot.safety.state_machine import Command
from tests.robot.recording.drives import Robot

pytest.importorskip("mcap")

AGES = Inputs(frame_age_s=0.1, pose_age_s=0.2, link_age_s=0.3, manual_age_s=0.4)


@pytest.fixture
def robot(tmp_path: Path) -> Robot:
    return Robot(tmp_path / "robot")


def driven(robot: Robot, command: Command) -> Tick:
    robot.turn()
    robot.ask(Command.ARM)
    robot.ask(command, WheelSpeeds(0.2, -0.1))
    return robot.turns(3)[-1]


def written(folder: Path, robot: Robot, heard: Sequence[Heard], **about: str) -> Path:
    file = DriveFile(folder / "a.mcap", {**robot.subject().about, **about})
    log = DriveLog(file, 0.0, {MODEL: robot.model})
    for each in heard:
        log.write(each)
    file.close()
    return file.path


def test_a_turn_is_told_as_it_was(robot: Robot) -> None:
    values = np.array([0.1, 0.9, 0.4, 0.0, 0.2], np.float32)
    tick = driven(robot, Command.AUTO)
    verdict = tick.verdict._replace(reason=Reason.PERSON, sentence="in words")
    own = {"values": values, "inputs": AGES, "verdict": verdict}
    turn = Turn.of(replace(tick, duration_s=0.011, lag_s=0.022, **own))
    assert (turn.duration_s, turn.lag_s) == (0.011, 0.022)
    assert (turn.reason, turn.sentence) == ("person", "in words")
    assert (turn.frame_age_s, turn.pose_age_s, turn.operator_age_s) == (0.1, 0.2, 0.3)
    assert turn.margin == pytest.approx(0.5), "of the best over the second"


def test_what_a_person_drove_is_decided_again_too(robot: Robot, tmp_path: Path) -> None:
    tick = driven(robot, Command.MANUAL)
    assert replay(written(tmp_path / "true", robot, [Heard(tick)])).differences == []
    false = replace(tick, wheels=WheelSpeeds(0.2, 0.1))
    (found,) = replay(written(tmp_path / "false", robot, [Heard(false)])).differences
    assert "came out as" in found.sentence


def test_a_slower_robot_is_decided_again_by_its_own_limit(robot: Robot, tmp_path: Path) -> None:
    tick = driven(robot, Command.MANUAL)
    assert tick.drive is not None
    slow = [Heard(replace(tick, wheels=tick.drive.limited(0.1)))]
    path = written(tmp_path / "slow", robot, slow, max_wheel_mps="0.1")
    assert replay(path).differences == []
    assert replay(written(tmp_path / "fast", robot, slow)).differences


def test_a_hundredth_is_more_than_any_processor_errs_by(
    robot: Robot, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    tick = driven(robot, Command.AUTO)
    assert tick.values is not None
    path = written(tmp_path / "off", robot, [Heard(replace(tick, values=1.01 * tick.values))])
    monkeypatch.setattr(module, "arithmetic", lambda: {"onnxruntime": "another"})
    (found,) = replay(path).differences
    assert found.sentence.startswith("values")


def test_a_turn_whose_picture_was_lost_is_no_decision(robot: Robot, tmp_path: Path) -> None:
    tick = driven(robot, Command.AUTO)
    file = DriveFile(tmp_path / "a.mcap", robot.subject().about)
    file.attach(MODEL, robot.model.read_bytes(), 0.0)
    file.add(topics.TURN, tick.time_s, Turn.of(tick).plain())
    file.close()
    found = replay(file.path)
    assert [each.sentence for each in found.differences] == ["its frame was not recorded"]
    assert found.decisions == 0


def test_a_sample_is_a_turn_with_what_it_saw_told_once(robot: Robot, tmp_path: Path) -> None:
    tick = driven(robot, Command.AUTO)
    report = Telemetry("daisy", "AUTO", wheels=(0.3, 0.3))
    later = [replace(tick, time_s=tick.time_s + late_s) for late_s in (0.0, 0.25, 0.35)]
    path = written(tmp_path / "a", robot, [Heard(each, report=report) for each in later])
    times_s = [sample.time_s for sample in read_samples(path)]
    assert times_s == pytest.approx([tick.time_s, tick.time_s + 0.25], abs=1e-6)


def samples(*told: object) -> List[Sample]:
    """Times [s] and drivers by turns."""
    pairs = zip(told[::2], told[1::2])
    return [Sample(float(str(t)), b"", WheelSpeeds(0, 0), str(who)) for t, who in pairs]


def test_who_drives_after_a_gap_took_nothing_over() -> None:
    before = samples(0.0, "policy", 0.1, "policy", 0.2, "policy", 0.3, "policy")
    assert take_overs(before + samples(0.4, "person")) == 1
    assert take_overs(before + samples(5.0, "person", 5.1, "person")) == 0


def test_the_usual_time_between_turns_is_no_matter_of_where_the_gaps_lie() -> None:
    every = samples(*(each for t in (0.0, 0.1, 0.2, 9.0, 9.1, 9.2) for each in (t, "policy")))
    assert [len(run) for run in runs(every)] == [3, 3]
