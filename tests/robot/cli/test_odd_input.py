"""Files and people that are odd: one line and status 2, never a traceback; off is off whatever."""

from __future__ import annotations

import io
import os
import signal
import subprocess
import sys
import threading
import time
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Iterator, List

import pytest

from robot.bringup.roller import Prompts
from robot.cli import calibrate, doctor, main, off, selftest
from robot.cli.install import ROOT
from robot.computer.machine import Machine
from robot.config import CameraConfig, RobotConfig
from robot.errors import ConfigError, ContractError
from robot.hat.bus import USUAL_ADDRESSES
from robot.typed_config import from_plain, load_yaml
from tests.robot.tiny_onnx import lane_contract, write_policy

ODD = ["name: !!bool x", "name: !!int ''", "name: !!float ''", "name: !!timestamp x"]


@pytest.mark.parametrize("text", ODD)
def test_what_pyyaml_trips_over_is_told_in_one_line(tmp_path: Path, text: str) -> None:
    path = tmp_path / "robot.yaml"
    path.write_text(f"model: m\n{text}\n")
    with pytest.raises(ConfigError, match="expected YAML"):
        load_yaml(RobotConfig, path)


@pytest.mark.parametrize(
    "text", [*ODD, "hat: {bus: .inf}", "hat: {socket: [1]}", "hat: {socket: 3}"]
)
def test_the_usual_buses_are_switched_off_whatever_the_file_says(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, text: str
) -> None:
    path = tmp_path / "robot.yaml"
    path.write_text(f"{text}\n")
    tried: List[Any] = []
    monkeypatch.setattr(off, "open_bus", lambda where: where)
    monkeypatch.setattr(off, "switch_off", lambda *told: tried.append(told[:2]) or "off")
    assert main(["off", "--config", str(path)]) == 2
    assert tried == [(1, [*USUAL_ADDRESSES])]


@pytest.mark.parametrize("name", ["my robot", "Größe", "", "a/b", "a\0b", "x" * 33])
def test_a_name_that_no_message_takes_is_refused_by_the_file(name: str) -> None:
    with pytest.raises(ConfigError, match="name: expected 1 to 32"):
        from_plain(RobotConfig, {"model": "m", "name": name})


def test_a_camera_number_that_opencv_cannot_count_to_is_refused() -> None:
    with pytest.raises(ConfigError, match="0 to 999"):
        CameraConfig("v4l2", number=5_000_000_000)


def test_the_doctor_goes_on_after_an_odd_picture() -> None:
    class Odd(Machine):
        def watch(self, *_: object) -> Any:
            raise ContractError("/dev/video0: expected a picture, got: a torn JPEG")

    found = doctor._camera(Odd(), CameraConfig("v4l2"))
    assert (found.level, "torn JPEG" in found.says) == (doctor.FAIL, True)


@pytest.mark.parametrize("rule", ["stop_lines", "headway"])
def test_the_doctor_fails_rules_that_drive_refuses(tmp_path: Path, rule: str) -> None:
    model = write_policy(tmp_path / "m.onnx", lane_contract())
    plain = {"model": str(model), "map": "town", "rules": {rule: True}, "link": {"keys": "k"}}
    found = doctor.check_policy(from_plain(RobotConfig, plain))
    assert found.level == doctor.FAIL


def test_a_calibration_that_could_not_be_kept_does_not_begin(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def refused(**_: object) -> None:
        raise PermissionError(13, "Permission denied")

    config = tmp_path / "robot.yaml"
    config.write_text("model: m\n")
    monkeypatch.setattr("robot.output.tempfile.NamedTemporaryFile", refused)
    monkeypatch.setattr(calibrate, "real_motors", lambda _: pytest.fail("it would drive"))
    assert main(["calibrate", "trim", "--config", str(config)]) == 2
    assert "robot.yaml: expected a place to write to" in capsys.readouterr().err


def test_an_answer_that_is_no_text_is_asked_again(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "stdin", io.TextIOWrapper(io.BytesIO(b"\xe4\ny\n"), "utf-8"))
    assert Prompts().agrees("is it so?")


def test_who_has_no_input_at_all_is_told() -> None:
    ask = "from robot.bringup.roller import Prompts; Prompts().agrees('?')"
    command = f'exec {sys.executable} -c "{ask}" <&-'
    done = subprocess.run(command, shell=True, cwd=str(ROOT), stderr=subprocess.PIPE, check=False)
    assert b"ConfigError: expected a person who answers" in done.stderr


@pytest.mark.parametrize("quoted", ["may not be opened", "others can read it"])
def test_the_manual_quotes_what_the_robot_says(quoted: str) -> None:
    manual = (ROOT / "docs" / "troubleshooting.md").read_text(encoding="utf-8")
    said = "".join(path.read_text(encoding="utf-8") for path in (ROOT / "robot").rglob("*.py"))
    assert f"`{quoted}`" in manual
    assert quoted in said


def test_a_drive_without_an_input_is_told_nothing_of_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    died: List[Any] = []
    monkeypatch.setattr("threading.excepthook", died.append)
    monkeypatch.setattr("sys.stdin", None)
    config = tmp_path / "robot.yaml"
    config.write_text("model: none.onnx\n")
    assert main(["drive", "--config", str(config)]) == 2, "no such model"
    for thread in [t for t in threading.enumerate() if t.name == "terminal"]:
        thread.join(5.0)
    assert died == []


@pytest.mark.parametrize("how", [signal.SIGTERM, signal.SIGHUP])
@pytest.mark.parametrize("words", [["selftest"], ["calibrate", "trim"], ["calibrate", "baseline"]])
def test_a_terminal_that_goes_away_ends_a_command_that_moves_as_ctrl_c_does(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, words: List[str], how: signal.Signals
) -> None:
    ended: List[bool] = []

    @contextmanager
    def motors(_: object) -> Iterator[None]:
        try:
            os.kill(os.getpid(), how)
            time.sleep(5.0)
            yield
        finally:
            ended.append(True)

    for command in (selftest, calibrate):
        monkeypatch.setattr(command, "real_motors", motors)
    (tmp_path / "robot.yaml").write_text("model: m\n")
    before = {number: signal.getsignal(number) for number in (signal.SIGTERM, signal.SIGHUP)}
    try:
        for number in before:
            signal.signal(number, lambda *_: None)
        assert main([*words, "--config", str(tmp_path / "robot.yaml")]) == 130
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
    assert ended == [True]
