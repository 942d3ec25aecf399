"""Lock-step: time stands still while a process works, whatever it said before."""

import math
import socket
import threading
import time
from pathlib import Path

import pytest

from sim_pybullet.virtual.clock import VirtualClock
from tools.loop import timekeeper
from tools.loop.stepper import GO, IDLE
from tools.loop.timekeeper import START_S, BenchError, Conductor, Timekeeper


def test_who_said_once_too_often_that_it_waits_is_waited_for_all_the_same(tmp_path: Path) -> None:
    conductor, worked = Conductor(tmp_path, ("robot",)), threading.Event()
    robot = socket.socket(socket.AF_UNIX)
    robot.connect(str(conductor.path))
    robot.sendall(b"robot".ljust(16))
    conductor.joined("robot", lambda: True)
    robot.sendall(IDLE.pack(START_S + 0.1, 0))

    def work() -> None:
        assert robot.recv(1) == GO
        robot.sendall(IDLE.pack(START_S + 9.0, 0))  # under way since before
        time.sleep(0.3)
        worked.set()
        robot.sendall(IDLE.pack(math.inf, 1))

    thread = threading.Thread(target=work)
    thread.start()
    conductor.run_until(START_S + 0.2)
    assert worked.is_set()
    thread.join()
    robot.close()
    conductor.end()


def test_who_was_started_again_is_waited_for_though_nobody_heard_the_end(tmp_path: Path) -> None:
    conductor = Conductor(tmp_path, ("robot",))

    def joins(until_s: float) -> socket.socket:
        robot = socket.socket(socket.AF_UNIX)
        robot.connect(str(conductor.path))
        robot.sendall(b"robot".ljust(16))
        conductor.joined("robot", lambda: True)
        robot.sendall(IDLE.pack(until_s, 0))
        return robot

    joins(START_S + 5.0).close()  # as a process that was killed leaves it
    again, let_go = joins(START_S + 0.1), threading.Event()

    def work() -> None:
        again.settimeout(2.0)
        if again.recv(1) == GO:
            let_go.set()
        again.sendall(IDLE.pack(math.inf, 1))

    thread = threading.Thread(target=work)
    thread.start()
    conductor.run_until(START_S + 0.2)
    thread.join()
    assert let_go.is_set()
    again.close()
    conductor.end()


def test_what_comes_late_keeps_its_rhythm_and_what_was_missed_is_skipped() -> None:
    clock, moments = VirtualClock(), list[float]()
    keeper = Timekeeper(clock)
    keeper.every(0.1, lambda: clock.sleep(0.05))
    keeper.every(0.07, lambda: moments.append(round(clock.now(), 3)))
    keeper.run_until(0.3)
    assert moments == [0.07, 0.15, 0.25, 0.28]


def test_who_was_stopped_is_not_waited_for(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(timekeeper, "PATIENCE_S", 2.0)
    conductor = Conductor(tmp_path, ("robot",))
    robot = socket.socket(socket.AF_UNIX)
    robot.connect(str(conductor.path))
    robot.sendall(b"robot".ljust(16))
    conductor.joined("robot", lambda: True)
    conductor.freeze("robot", True)
    conductor.run_until(START_S + 0.2)
    assert conductor.clock.now() == START_S + 0.2
    robot.setblocking(False)
    with pytest.raises(BlockingIOError):
        robot.recv(1)  # nor is it given time
    conductor.freeze("robot", False)
    with pytest.raises(BenchError, match="robot: no end to its work"):
        conductor.settle()
    robot.close()
    conductor.end()
