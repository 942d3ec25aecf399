"""A policy brings its own actions: seven here, with a stop, from the loop to the replay."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import List

import pytest

from robot.camera.files import write_png
from robot.cli import main
from robot.contract import PolicyContract, action_name
from robot.errors import ContractError
from robot.geometry import WheelSpeeds
from robot.inference.policy import OnnxPolicy
from robot.link.messages import Telemetry
from robot.parts import Tick
from robot.recording.drive_file import MODEL, DriveFile, DriveLog, Heard
from robot.recording.reader import entries
from robot.recording.replay import replay
from robot.recording.topics import TELEMETRY
from robot.runtime.loop import Runtime
from robot.runtime.reports import Reporter
from robot.safety.gates import SafetyLimits
from robot.safety.state_machine import MOVING, Command, Safety, State
from tests.robot.clocks import FakeClock
from tests.robot.fakes import FakeMotors
from tests.robot.recording.drives import ColourCamera
from tests.robot.tiny_onnx import FIXTURES, lane_contract, write_network

# Red, green, blue and black choose the first four.
SEVEN = (
    *((0.05, 0.1), (0.0, 0.0), (0.3, 0.3), (0.1, 0.05)),
    *((-0.1, -0.1), (0.2, 0.25), (0.25, 0.2)),
)
STOP = 1


def test_pictures_behind_each_other_lie_along_the_colour_axis() -> None:
    assert replace(lane_contract(), frames=4).picture_shape == (120, 160, 12)


def write_seven(path: Path) -> Path:
    text = lane_contract(actions=SEVEN).to_json()
    network = (FIXTURES / "seven.onnx").read_bytes()
    return write_network(path, network, {PolicyContract.METADATA_KEY: text})


class Drive:
    """A robot of fakes around the policy, and what it reported."""

    def __init__(self, folder: Path) -> None:
        self.model = write_seven(folder / "seven.onnx")
        policy, clock = OnnxPolicy(self.model), FakeClock()
        self.reports: List[Telemetry] = []
        about = Telemetry("daisy", "DISARMED", actions=policy.contract.actions)
        feed = Reporter(self.reports.append, None, about, SafetyLimits())
        safety = Safety(clock)
        self.motors = FakeMotors(lambda: safety.verdict.state in MOVING)
        self.runtime = Runtime(
            ColourCamera(clock), policy, self.motors, safety, clock, subscribers=(feed,)
        )
        self._clock = clock

    def turns(self, count: int) -> List[Tick]:
        ticks = []
        for _ in range(count):
            ticks.append(self.runtime.step())
            self._clock.now_s += 0.1
        return ticks

    def drive(self, count: int) -> List[Tick]:
        self.turns(1)
        for command in (Command.ARM, Command.AUTO):
            assert self.runtime.ask(command).accepted
        return self.turns(count)


def test_the_wheels_do_what_the_policys_own_table_says(tmp_path: Path) -> None:
    robot = Drive(tmp_path)
    ticks = robot.drive(12)
    assert robot.motors.objections == []
    assert {tick.action for tick in ticks} == {0, 1, 2, 3}
    for tick in ticks:
        assert tick.verdict.state is State.AUTO
        assert tick.action is not None
        assert tick.drive is not None
        assert tuple(tick.drive.wanted) == SEVEN[tick.action]
    stopped = [tick for tick in ticks if tick.action == STOP]
    assert stopped
    assert all(tick.wheels == WheelSpeeds(0.0, 0.0) for tick in stopped)


def test_the_drive_is_recorded_and_decided_again_bit_for_bit(tmp_path: Path) -> None:
    pytest.importorskip("mcap")
    robot = Drive(tmp_path)
    ticks = robot.drive(12)
    found = replay(record(robot, tmp_path / "true", ticks))
    assert (found.decisions, found.differences, found.worst) == (12, [], 0.0)
    stop = next(tick for tick in ticks if tick.action == STOP)
    assert stop.drive is not None
    false = replace(stop, drive=stop.drive._replace(wanted=WheelSpeeds(0.3, 0.3)))
    found = replay(record(robot, tmp_path / "false", [false]))
    assert "are not those of STOP" in found.differences[0].sentence
    beyond = replay(record(robot, tmp_path / "beyond", [replace(stop, action=9)]))
    assert any("does not have" in each.sentence for each in beyond.differences)


def record(robot: Drive, folder: Path, ticks: List[Tick]) -> Path:
    from robot.recording.drive_file import arithmetic

    folder.mkdir()
    file = DriveFile(folder / "a.mcap", arithmetic())
    log = DriveLog(file, 0.0, {MODEL: robot.model})
    for tick, report in zip(ticks, robot.reports[-len(ticks) :]):
        log.write(Heard(tick, report=report))
    file.close()
    for entry in entries(file.path, TELEMETRY):
        assert entry.message()["actions"] == [list(wheels) for wheels in SEVEN]
    return file.path


def test_the_monitor_is_told_the_table_with_the_values(tmp_path: Path) -> None:
    robot = Drive(tmp_path)
    robot.drive(8)
    report = Telemetry.from_bytes(robot.reports[-1].to_bytes())
    assert report.actions == SEVEN
    assert len(report.values) == 7
    assert report.action == STOP
    with pytest.raises(ContractError):
        replace(report, action=7)
    with pytest.raises(ContractError):
        replace(report, actions=((float("nan"), 0.0),) * 7)
    assert len(Telemetry("d", "READY").actions) == 5  # of a robot that tells no table


def test_infer_names_and_counts_the_actions(tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    import numpy as np

    for name, colour in (("red", (255, 0, 0)), ("green", (0, 255, 0))):
        write_png(tmp_path / "in" / f"{name}.png", np.full((120, 160, 3), colour, np.uint8))
    model = write_seven(tmp_path / "m.onnx")
    words = ["--images", str(tmp_path / "in"), "--json", str(tmp_path / "a.json")]
    assert main(["infer", "--model", str(model), *words]) == 0
    out = capsys.readouterr().out
    assert "+0.05|+0.10 1, STOP 1, STRAIGHT 0" in out


def test_names_of_actions() -> None:
    assert [action_name(wheels) for wheels in lane_contract().actions] == [
        *("LEFT", "SLIGHT_LEFT", "STRAIGHT", "SLIGHT_RIGHT", "RIGHT")
    ]
    assert action_name((0.0, 0.0)) == "STOP"
    assert action_name((-0.1, 0.25)) == "-0.10|+0.25"
