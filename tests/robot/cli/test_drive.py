"""The drive command, with a robot of made-up parts, as systemd starts it."""

from __future__ import annotations

import io
import os
import signal
import socket
import threading
import time
from contextlib import contextmanager, nullcontext
from pathlib import Path
from types import SimpleNamespace
from typing import Any, Callable, Iterator, List, Tuple

import pytest

from robot.cli import drive, main
from robot.computer.systemd import on_ending
from robot.geometry import Pose
from robot.runtime.assemble import open_robot
from robot.runtime.loop import Runtime
from robot.safety.state_machine import Answer, Command, State
from tests.robot.runtime.test_assemble import DarkCamera, RollingMotors
from tests.robot.tiny_onnx import lane_contract, write_policy


@pytest.mark.usefixtures("hears_signals")
@pytest.mark.parametrize("how", [signal.SIGTERM, signal.SIGHUP])
def test_systemd_hears_ready_the_state_the_heart_and_the_end(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    how: signal.Signals,
) -> None:
    runtimes: List[Runtime] = []

    @contextmanager
    def made_up(*arguments: Any) -> Iterator[Runtime]:
        motors = RollingMotors(Pose(0.0, 0.0, 0.0))
        parts = {"camera": nullcontext(DarkCamera()), "motors": nullcontext(motors)}
        with open_robot(*arguments, **parts) as runtime:
            runtimes.append(runtime)
            yield runtime

    model = write_policy(tmp_path / "lane.onnx", lane_contract())
    (tmp_path / "robot.yaml").write_text(f"model: {model}\n")
    monkeypatch.setattr(drive, "open_robot", made_up)
    monkeypatch.setattr("robot.runtime.timing.SILENCE_S", 30.0)  # on a busy computer, too
    monkeypatch.setattr("sys.stdin", open(os.devnull))  # noqa: SIM115  as under systemd
    monkeypatch.setenv("NOTIFY_SOCKET", str(tmp_path / "notify"))
    heard: List[str] = []
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as systemd:
        systemd.settimeout(20.0)
        systemd.bind(str(tmp_path / "notify"))

        def listen_then_end() -> None:
            while heard.count("WATCHDOG=1") < 3:
                heard.append(systemd.recv(200).decode())
            os.kill(os.getpid(), how)
            while heard[-1] != "STOPPING=1":
                heard.append(systemd.recv(200).decode())

        thread = threading.Thread(target=listen_then_end)
        thread.start()
        began_s = time.monotonic()
        before = {number: signal.getsignal(number) for number in (signal.SIGTERM, signal.SIGHUP)}
        try:
            assert main(["drive", "--config", str(tmp_path / "robot.yaml")]) == 0
        finally:
            for number, handler in before.items():
                signal.signal(number, handler)
            thread.join()
    assert (heard[0], heard[-1]) == ("READY=1", "STOPPING=1")
    assert any(line.startswith("STATUS=DISARMED") for line in heard)
    said = capsys.readouterr().out.splitlines()
    assert said[0].startswith("type arm, auto, stop")
    assert [line for line in said if line.startswith("DISARMED: ")], "as at a terminal"
    assert time.monotonic() - began_s >= 1.0
    assert runtimes[0].safety.verdict.state is State.DISARMED


def test_a_hang_up_that_nohup_wants_ignored_stays_ignored() -> None:
    before = {number: signal.getsignal(number) for number in (signal.SIGTERM, signal.SIGHUP)}
    ended: List[bool] = []
    try:
        signal.signal(signal.SIGHUP, signal.SIG_IGN)
        on_ending(lambda *_: ended.append(True))
        os.kill(os.getpid(), signal.SIGHUP)
        assert ended == []
        os.kill(os.getpid(), signal.SIGTERM)
        assert ended == [True]
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def made_up_robot(
    folder: Path, monkeypatch: pytest.MonkeyPatch, run: Callable[[List[Any], Any], None]
) -> Tuple[List[str], List[Any]]:
    """The words that start a drive which only runs this, and the operators that it was given."""
    operators: List[Any] = []

    @contextmanager
    def opened(_: Any, heard: Any, __: Any) -> Iterator[Any]:
        operators.extend(heard)
        yield SimpleNamespace(run=lambda ending: run(operators, ending))

    (folder / "robot.yaml").write_text("model: lane.onnx\n")
    monkeypatch.setattr(drive, "open_robot", opened)
    monkeypatch.setattr(drive, "on_ending", lambda _: None)
    return ["drive", "--config", str(folder / "robot.yaml")], operators


def test_a_gamepad_is_an_operator_beside_the_terminal(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def ended(_: List[Any], ending: Any) -> None:
        assert not ending()

    words, operators = made_up_robot(tmp_path, monkeypatch, ended)
    monkeypatch.setattr("sys.stdin", open(os.devnull))  # noqa: SIM115
    assert main(words) == 0
    assert len(operators) == 1
    assert main([*words, "--gamepad", str(tmp_path / "js0")]) == 0
    pad = operators[2]
    pad.serve(lambda *_: None)
    assert pad.age_s() == float("inf"), "it is not there: nobody may drive"


def test_a_byte_that_is_no_text_does_not_deafen_the_terminal(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As of noise on a serial console."""
    asked: List[Any] = []

    def until(operators: List[Any], ending: Any) -> None:
        end_s = time.monotonic() + 10.0
        while not ending():
            assert time.monotonic() < end_s
            operators[0].serve(lambda *what: asked.append(what) or Answer(True, ""))

    words, _ = made_up_robot(tmp_path, monkeypatch, until)
    typed = io.TextIOWrapper(io.BytesIO(b"st\xffop\nstop\nquit\n"), "utf-8")
    monkeypatch.setattr("sys.stdin", typed)
    assert main(words) == 0
    assert set(asked) == {(Command.STOP, None)}  # the end of the input stops as well


def test_without_any_input_nobody_can_type_and_the_robot_is_stopped(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: List[Any] = []

    def until(operators: List[Any], _: object) -> None:
        end_s = time.monotonic() + 10.0
        while not asked:
            assert time.monotonic() < end_s
            operators[0].serve(lambda *what: asked.append(what) or Answer(True, ""))

    words, _ = made_up_robot(tmp_path, monkeypatch, until)
    died: List[Any] = []
    monkeypatch.setattr(threading, "excepthook", died.append)
    monkeypatch.setattr("sys.stdin", None)
    assert main(words) == 0
    assert asked == [(Command.STOP, None)]
    assert died == []
