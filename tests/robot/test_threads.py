"""Waits that go by a clock which nobody can set, on Python 3.8 as well."""

from __future__ import annotations

import ast
import fcntl
import gc
import os
import resource
import threading
import time
from pathlib import Path
from types import SimpleNamespace
from typing import Any, List, Optional, Tuple

import numpy as np
import pytest

import robot
from robot.camera.source import NewestFrame
from robot.computer.clock import Alarm, MonotonicClock
from robot.computer.threads import Silence, Worker
from robot.errors import HardwareError
from robot.geometry import WheelSpeeds
from robot.hat.config import HatConfig
from robot.hat.driver import MotorDriver
from robot.hat.stepper_hat import StepperHat
from robot.hat.thread import MotorThread
from robot.runtime.timing import Watchdog
from sim_pybullet.virtual.hat import VirtualHat
from sim_pybullet.virtual.i2c import VirtualI2cBus
from tests.robot.camera.test_newest import FakeStream, eventually


def test_it_rings_until_it_is_cleared() -> None:
    alarm = Alarm()
    assert not alarm.is_set()
    assert not alarm.wait(0.0)
    assert not alarm.wait(-1.0)
    for _ in range(3):
        alarm.set()
        assert alarm.is_set()
    assert alarm.wait()
    assert alarm.wait(10.0)
    for _ in range(2):
        alarm.clear()
        assert not alarm.wait(0.0)
    began_s = time.monotonic()
    assert not alarm.wait(0.05)
    assert time.monotonic() - began_s >= 0.05, "it was rung often and cleared once"


def test_the_steady_clock_is_the_monotonic_one_and_never_waits_backwards() -> None:
    clock, before_s = MonotonicClock(), time.monotonic()
    clock.sleep(-1.0)
    clock.sleep(0.0)
    assert before_s <= clock.now() <= time.monotonic()
    before_s = time.monotonic()
    clock.sleep(0.02)
    assert time.monotonic() - before_s >= 0.02


def test_a_wait_lasts_as_long_as_it_should_and_ends_with_the_ringing() -> None:
    alarm = Alarm()
    began_s = time.monotonic()
    assert not alarm.wait(0.05)
    assert 0.05 <= time.monotonic() - began_s < 2.0
    ringer = threading.Thread(target=lambda: (time.sleep(0.05), alarm.set()))
    ringer.start()
    assert alarm.wait(60.0)
    assert time.monotonic() - began_s < 10.0
    ringer.join()


def test_it_rings_and_waits_where_many_descriptors_are_open(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A crowd of connections can push a new pipe beyond what ``select`` takes."""
    pipe = os.pipe

    def high() -> Tuple[int, int]:
        low = pipe()
        fds = tuple(fcntl.fcntl(fd, fcntl.F_DUPFD, 1500) for fd in low)
        for fd in low:
            os.close(fd)
        return fds[0], fds[1]

    before = resource.getrlimit(resource.RLIMIT_NOFILE)
    if before[1] < 1600:
        pytest.skip(f"needs 1600 descriptors, this machine gives {before[1]}")
    resource.setrlimit(resource.RLIMIT_NOFILE, (max(before[0], 1600), before[1]))
    try:
        monkeypatch.setattr(os, "pipe", high)
        alarm = Alarm()
        monkeypatch.undo()
        began_s = time.monotonic()
        assert not alarm.wait(0.02)
        assert time.monotonic() - began_s >= 0.02
        alarm.set()
        assert alarm.wait(10.0)
    finally:
        del alarm
        gc.collect()
        resource.setrlimit(resource.RLIMIT_NOFILE, before)


def test_poll_is_asked_for_no_shorter_a_time_and_for_ever(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: List[Optional[int]] = []
    poll = SimpleNamespace(register=lambda *_: None, poll=asked.append)
    monkeypatch.setattr("robot.computer.clock._SELECTABLE", 0)
    monkeypatch.setattr("select.poll", lambda: poll)
    alarm = Alarm()
    for timeout_s in (0.0201, 0.0, -1.0, None):
        assert not alarm.wait(timeout_s)
    assert asked == [21, 0, 0, None]


def test_its_descriptors_go_with_it() -> None:
    before = len(os.listdir("/proc/self/fd"))
    alarms = [Alarm() for _ in range(20)]
    assert len(os.listdir("/proc/self/fd")) == before + 40
    alarms.clear()
    gc.collect()
    assert len(os.listdir("/proc/self/fd")) == before


@pytest.fixture
def _no_timed_waits(monkeypatch: pytest.MonkeyPatch) -> None:
    """Every timed wait of ``threading`` goes through these two on Python 3.8, by the wall clock."""
    wait, join = threading.Condition.wait, threading.Thread.join

    def untimed_wait(condition: Any, timeout: Any = None) -> bool:
        assert timeout is None, "a timed wait of threading"
        return wait(condition)

    def untimed_join(thread: threading.Thread, timeout: Any = None) -> None:
        assert timeout is None, "a timed join"
        join(thread)

    monkeypatch.setattr(threading.Condition, "wait", untimed_wait)
    monkeypatch.setattr(threading.Thread, "join", untimed_join)


@pytest.mark.usefixtures("_no_timed_waits")
def test_motors_watchdog_and_camera_never_wait_by_the_wall_clock(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("robot.camera.source.FIRST_WAIT_S", 0.01)
    clock, bus, config = MonotonicClock(), VirtualI2cBus(), HatConfig()
    VirtualHat(bus, clock)
    driver = MotorDriver(StepperHat(bus, config, clock), config, clock)
    looks: List[float] = []
    levels, before = [[10, 20], [30]], FakeStream.opened

    def open_stream() -> FakeStream:
        return FakeStream(levels.pop(0) if levels else [])

    camera = NewestFrame(open_stream, time.monotonic)
    watchdog = Watchdog(lambda: looks.append(time.monotonic()))
    with MotorThread(driver, clock) as motors, watchdog, camera:

        def all_turn() -> bool:
            motors.set_wheels(WheelSpeeds(0.1, 0.1))
            return motors.counts[0] > 4 and len(looks) > 4 and FakeStream.opened - before > 2

        eventually(all_turn)
        for thread in (motors, watchdog, camera):
            thread.check()
    assert np.diff(looks).min() > 0.04


def test_no_module_of_the_robot_makes_a_wait_of_threading() -> None:
    made: List[Tuple[str, str]] = []
    waits = {"Condition", "Event", "Semaphore", "BoundedSemaphore", "Barrier", "Timer"}
    for path in Path(robot.__file__).parent.rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Attribute) and node.attr in waits:
                made.append((path.name, node.attr))
            if isinstance(node, ast.keyword) and node.arg == "timeout":
                made.append((path.name, "timeout="))
    assert made == [], "robot.computer.threads.Alarm does not depend on the wall clock"


def test_a_worker_that_does_not_end_is_waited_for_by_its_patience() -> None:
    """A camera's device may hang; the join must be neither endless nor by the wall clock."""
    hang = threading.Event()

    class Hanging:
        def grab(self) -> np.ndarray:
            hang.wait()
            raise HardwareError("ended")

        def close(self) -> None:
            """Nothing to give back."""

    camera = NewestFrame(Hanging, time.monotonic)
    camera._patience_s = 0.1
    began_s = time.monotonic()
    with camera:
        eventually(lambda: camera.alive)
    assert 0.1 <= time.monotonic() - began_s < 3.0
    hang.set()
    eventually(lambda: not camera.alive)


class Stubborn(Worker):
    """Works until it is let go, then ends as it was told; nothing wakes it."""

    def __init__(self, end: Optional[BaseException] = None) -> None:
        super().__init__("stubborn", 0.1)
        self.let_go = threading.Event()
        self._end = end

    def _work(self) -> None:
        self.let_go.wait()
        if self._end is not None:
            raise self._end


def test_a_worker_that_was_begun_anew_is_waited_for_by_its_patience_too() -> None:
    worker = Stubborn()
    worker.let_go.set()
    with worker:
        eventually(lambda: not worker.alive)
    worker.let_go.clear()
    worker.start()
    assert worker._thread is not None
    assert worker._thread.daemon, "nor does a program wait for it that ends"
    ender = threading.Thread(target=worker.end, daemon=True)
    ender.start()
    eventually(lambda: not ender.is_alive())
    assert worker.alive
    worker.let_go.set()
    eventually(lambda: not worker.alive)


@pytest.mark.parametrize("end", [SystemExit(1), KeyboardInterrupt(), GeneratorExit()])
def test_whatever_ends_a_worker_is_heard_of(end: BaseException) -> None:
    worker = Stubborn(end)
    worker.let_go.set()
    with worker:
        eventually(lambda: worker._died is not None)
        assert not worker.alive
        with pytest.raises(HardwareError, match=f"stubborn thread: {type(end).__name__}"):
            worker.check()


def test_who_does_not_turn_for_so_many_looks_and_so_long_hangs() -> None:
    silence = Silence(3, 0.5)
    for now_s in (100.0, 101.0, 102.0):
        assert not silence.lasts(1, now_s), "long enough, but looked at three times"
    assert silence.lasts(1, 103.0)
    for now_s in (103.1, 103.2, 103.3, 103.4, 103.5, 103.6):
        assert not silence.lasts(2, now_s), "looked at often enough, but for half a second"
    assert silence.lasts(2, 103.7)
    assert not silence.lasts(0, 200.0), "one that was begun anew counts from the beginning"
    assert not silence.lasts(0, 300.0)


def test_a_thread_that_has_not_turned_yet_is_silent_since_the_first_look() -> None:
    silence = Silence(1, 0.5)
    for now_s in (100.0, 100.2, 100.4):
        assert not silence.lasts(0, now_s)
    assert silence.lasts(0, 100.6)
