"""The command that replays a recording, by its exit status and what it says."""

from dataclasses import replace
from pathlib import Path

import pytest

from robot.link.messages import FrameMessage, MissionStatus, Telemetry
from robot.parts import Tick
from robot.recording.drive_file import MODEL, DriveFile, DriveLog, Heard
from robot.recording.topics import TURN
from tests.robot.recording.drives import Robot
from tests.robot.tiny_onnx import lane_contract, write_policy
from tools.monitor.drives import DriveRecorder
from tools.replay import main

GOLDEN = Path(__file__).parents[1] / "data" / "golden_drive.mcap"


def test_a_recording_that_comes_out_alike(capsys: pytest.CaptureFixture[str]) -> None:
    assert main([str(GOLDEN)]) == 0
    assert "34 decisions of 34 turns replayed" in capsys.readouterr().out


def test_another_policy_decides_otherwise(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    other = write_policy(tmp_path / "other.onnx", lane_contract())
    assert main([str(GOLDEN), "--model", str(other)]) == 1
    told = capsys.readouterr().out
    assert "… and 14 more" in told
    assert "34 decisions of 34 turns replayed" in told
    assert "34 differ" in told


def refusal(path: Path, capsys: pytest.CaptureFixture[str], *more: str) -> str:
    """What the command says of a file with which it can do nothing: one line, status 2."""
    assert main([str(path), *more]) == 2
    told = capsys.readouterr()
    assert told.out == ""
    assert told.err.count("\n") == 1
    assert told.err.startswith(f"tools.replay: {path}: ")
    return told.err


@pytest.mark.parametrize(
    ("data", "told"),
    [
        (b"", "got an empty file"),
        (b"hi\n", "a file that begins with b'hi"),
        (b"nothing of the kind, but longer than any magic " * 9, "begins with b'nothing"),
        ("Größe: 1 m\n".encode(), "expected an MCAP recording"),
        (b"PK\x03\x04" + bytes(99), "begins with b'PK"),
        (b"\x89MCAP", "expected an MCAP recording"),
        (b"\x89MCAP0\r\n", "expected the policy in the recording"),
    ],
)
def test_what_is_no_recording_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], data: bytes, told: str
) -> None:
    (tmp_path / "notes.mcap").write_bytes(data)
    assert told in refusal(tmp_path / "notes.mcap", capsys)


def test_a_folder_and_a_file_that_is_not_there(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert "Is a directory" in refusal(tmp_path, capsys)
    assert "No such file" in refusal(tmp_path / "none.mcap", capsys)


@pytest.mark.parametrize("model", [False, True])
def test_a_monitors_recording_says_what_it_lacks(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], model: bool
) -> None:
    recorder = DriveRecorder(tmp_path / "drives", lambda: 1.7e9)
    mission = MissionStatus("m1", (1.0, 0.0))
    for number in range(5):
        time_s = 10.0 + 0.1 * number
        recorder.take(Telemetry("duck", "AUTO", mission=mission, t_sent_s=time_s))
        recorder.take_frame(FrameMessage(b"\xff\xd8\xff\xd9", time_s))
    recorder.close()
    (path,) = (tmp_path / "drives").iterdir()
    policy = write_policy(tmp_path / "other.onnx", lane_contract())
    told = refusal(path, capsys, *(("--model", str(policy)) if model else ()))
    assert ("found no decision in its 0 turns" if model else "is it a monitor's?") in told


@pytest.mark.parametrize("model", [False, True])
def test_a_robot_that_the_policy_never_drove(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], model: bool
) -> None:
    robot = Robot(tmp_path / "robot")
    ticks = [replace(tick, values=None, action=None) for tick in robot.turns(4)]
    path = written(robot, tmp_path, ticks, policy=True)
    more = ("--model", str(robot.model)) if model else ()
    assert "found no decision in its 4 turns" in refusal(path, capsys, *more)


def written(robot: Robot, folder: Path, ticks: list[Tick], policy: bool) -> Path:
    file = DriveFile(folder / "a.mcap", robot.subject().about)
    log = DriveLog(file, 0.0, {MODEL: robot.model} if policy else {})
    for tick in ticks:
        log.write(Heard(tick))
    file.close()
    return file.path


def test_a_recording_without_its_policy_replays_with_one(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    robot = Robot(tmp_path / "robot")
    path = written(robot, tmp_path, robot.drive(5), policy=False)
    assert "Else name its file with --model" in refusal(path, capsys)
    assert main([str(path), "--model", str(robot.model)]) == 0


def test_a_recording_that_was_cut_off_before_the_first_turn(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    robot = Robot(tmp_path / "robot")
    path = written(robot, tmp_path, [], policy=False)
    assert "expected the policy in the recording" in refusal(path, capsys)


@pytest.mark.parametrize("turn", [[], {}, {"number": "x"}, "[" * 3000])
def test_turns_that_are_none_are_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], turn: object
) -> None:
    file = DriveFile(tmp_path / "a.mcap", {"robot": "daisy"})
    file.add(TURN, 0.0, turn)  # type: ignore[arg-type]
    file.close()
    policy = write_policy(tmp_path / "other.onnx", lane_contract())
    assert "expected turns of this version" in refusal(file.path, capsys, "--model", str(policy))
