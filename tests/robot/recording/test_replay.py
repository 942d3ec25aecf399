"""A recorded drive is decided again, bit for bit; what differs is found."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from robot.errors import ContractError
from robot.geometry import WheelSpeeds
from robot.inference.policy import OnnxPolicy
from robot.parts import Tick
from robot.recording import replay as module
from robot.recording.drive_file import MODEL, DriveFile, DriveLog, Heard
from robot.recording.reader import read_turns
from robot.recording.replay import replay
from robot.safety.state_machine import Command
from tests.robot.recording.drives import Robot, record
from tests.robot.tiny_onnx import lane_contract, write_policy

pytest.importorskip("mcap")


def test_every_decision_comes_out_bit_for_bit(tmp_path: Path) -> None:
    robot = Robot(tmp_path / "robot")
    ticks = robot.drive(40)
    (path,) = record(robot, tmp_path / "drives", ticks)
    found = replay(path)
    assert found.exact
    assert found.differences == []
    assert found.decisions == len(ticks) - 3
    assert found.worst == 0.0
    assert len({tick.action for tick in ticks}) >= 3


def test_who_was_told_its_last_commands_decides_by_them_again(tmp_path: Path) -> None:
    robot = Robot(tmp_path / "robot", lane_contract(commands=5))
    ticks = robot.drive(40)
    (path,) = record(robot, tmp_path / "drives", ticks)
    turns = [turn for turn, _ in read_turns(path)]
    assert [turn.commands for turn in turns] == [ticks[turn.number].commands for turn in turns]
    assert turns[-1].commands is not None
    assert turns[-1].commands[-4:-2] == pytest.approx((0.2 / 0.3459, -0.1 / 0.3459))
    assert turns[-1].commands[-2:] == (0.0, 0.0)
    found = replay(path)
    assert found.exact
    assert (found.differences, found.worst, found.decisions) == ([], 0.0, len(turns))
    other = Robot(tmp_path / "other")
    (path,) = record(other, tmp_path / "alone", other.drive(1))
    assert {turn.commands for turn, _ in read_turns(path)} == {None}, "it is told none"


def written(tick: Tick, robot: Robot, folder: Path) -> Path:
    file = DriveFile(folder / "a.mcap", robot.subject().about)
    DriveLog(file, 0.0, {MODEL: robot.model}).write(Heard(tick))
    file.close()
    return file.path


def auto(robot: Robot) -> Tick:
    robot.turn()
    robot.ask(Command.ARM)
    robot.ask(Command.AUTO)
    tick = robot.turns(2)[-1]
    assert tick.values is not None
    assert tick.action is not None
    assert tick.frame is not None
    return tick


def test_what_differs_is_found(tmp_path: Path) -> None:
    robot = Robot(tmp_path / "robot")
    tick = auto(robot)
    assert tick.values is not None
    assert tick.frame is not None
    assert tick.drive is not None
    assert replay(written(tick, robot, tmp_path / "true")).differences == []
    nudged = np.nextafter(tick.values, np.float32(9.0))
    other = tick.frame._replace(image=255 - tick.frame.image)
    tampered = {
        "values": replace(tick, values=nudged),
        "values ": replace(tick, frame=other),
        "by": replace(tick, action=(tick.action or 0) - 1),
        "wheels": replace(tick, wheels=tick.wheels._replace(left_mps=0.1)),
        "are not those of": replace(tick, drive=tick.drive._replace(wanted=WheelSpeeds(0.1, 0.1))),
    }
    for words, false in tampered.items():
        found = replay(written(false, robot, tmp_path / words)).differences
        assert words in found[0].sentence


def test_elsewhere_only_a_clear_choice_must_be_the_same(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    robot = Robot(tmp_path / "robot")
    tick = auto(robot)
    assert tick.values is not None
    nudged = replace(tick, values=np.nextafter(tick.values, np.float32(9.0)))
    path = written(nudged, robot, tmp_path / "nudged")
    assert replay(path).differences
    monkeypatch.setattr(module, "arithmetic", lambda: {"onnxruntime": "another"})
    found = replay(path)
    assert not found.exact
    assert found.differences == []
    assert found.worst > 0.0
    clear = replace(tick, action=(tick.action or 0) - 1)
    assert replay(written(clear, robot, tmp_path / "clear")).differences


def test_another_policy_can_be_asked(tmp_path: Path) -> None:
    robot = Robot(tmp_path / "robot")
    (path,) = record(robot, tmp_path / "drives", robot.drive(20))
    lane = OnnxPolicy(write_policy(tmp_path / "lane.onnx", lane_contract()))
    assert replay(path, lane).differences
    assert replay(path, OnnxPolicy(robot.model)).differences == []


def test_a_recording_without_its_policy_says_so(tmp_path: Path) -> None:
    DriveFile(tmp_path / "a.mcap", {}).close()
    with pytest.raises(ContractError, match="name its file"):
        replay(tmp_path / "a.mcap")
