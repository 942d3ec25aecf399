"""A thread of the robot that dies stops the robot: whoever relies on it hears of it."""

from __future__ import annotations

import dataclasses
import threading
import time
from pathlib import Path
from typing import Any, Callable, List, Optional

import numpy as np
import pytest

from robot.camera.source import Camera, Frame, NewestFrame
from robot.computer.clock import MonotonicClock
from robot.computer.threads import Worker
from robot.config import RecordingConfig
from robot.errors import HardwareError
from robot.hat.config import HatConfig
from robot.hat.driver import MotorDriver
from robot.hat.stepper_hat import StepperHat
from robot.hat.thread import MotorThread
from robot.inference.preprocess import FRAME_SHAPE
from robot.parts import Motors, Subscriber
from robot.recording.recorder import Recorder
from robot.runtime.loop import Runtime
from robot.runtime.timing import Watchdog
from robot.safety.gates import Reason, SafetyLimits
from robot.safety.state_machine import MOVING, Command, Safety, State
from sim_pybullet.virtual.hat import VirtualHat
from sim_pybullet.virtual.i2c import VirtualI2cBus
from tests.robot.clocks import FakeClock
from tests.robot.fakes import FakeMotors, FakePolicy
from tests.robot.recording.drives import Robot
from tests.robot.tiny_onnx import lane_contract

PATIENT = SafetyLimits(frame_age_s=9.0, loop_age_s=9.0)  # only a thread's death stops this robot


class Bomb:
    """Does nothing until it is lit; then whoever comes by dies."""

    def __init__(self) -> None:
        self.lit = False

    def __call__(self, *_: Any) -> None:
        if self.lit:
            raise KeyError("bug")


class Noise:
    """A camera's stream, or the camera itself."""

    def __init__(self, pass_by: Callable[[], None] = lambda: None) -> None:
        self._rng = np.random.default_rng(0)
        self._pass_by = pass_by
        self._sequence = 0

    def grab(self) -> np.ndarray:
        self._pass_by()
        time.sleep(0.005)
        return self._rng.integers(0, 256, FRAME_SHAPE, dtype=np.uint8)

    def read(self) -> Frame:
        self._sequence += 1
        return Frame(self.grab(), self._sequence, time.monotonic())

    def close(self) -> None:
        """Nothing to give back."""


class Driving:
    """A robot that drives on, with one real thread among fakes."""

    def __init__(
        self,
        camera: Optional[Camera] = None,
        motors: Optional[Motors] = None,
        subscribers: List[Subscriber] = [],  # noqa: B006  never changed
    ) -> None:
        clock = MonotonicClock()
        self.safety = Safety(clock.now, PATIENT)
        self.motors = motors or FakeMotors(lambda: self.safety.verdict.state in MOVING)
        parts = (self.motors, self.safety, clock, subscribers)
        policy = FakePolicy(FakeClock(), lane_contract())
        self.runtime = Runtime(camera or Noise(), policy, *parts)

    def drive_off(self) -> None:
        deadline_s = time.monotonic() + 5.0
        while self.safety.verdict.state is not State.AUTO:
            assert time.monotonic() < deadline_s, self.safety.verdict
            self.runtime.step()
            for command in (Command.ARM, Command.AUTO):
                self.runtime.ask(command)

    def steps(self, motors: MotorThread) -> None:
        while motors.counts == (0, 0):
            assert self.safety.verdict.state is State.AUTO, self.safety.verdict
            self.runtime.step()

    def stops(self) -> None:
        deadline_s = time.monotonic() + 5.0
        while self.safety.verdict.state is not State.FAULT:
            assert time.monotonic() < deadline_s, "it drives on without its thread"
            self.runtime.step()


def test_the_death_of_the_camera_thread_stops_the_motors() -> None:
    bomb = Bomb()
    with NewestFrame(lambda: Noise(bomb), time.monotonic) as camera:
        robot = Driving(camera=camera)
        robot.drive_off()
        bomb.lit = True
        robot.stops()
        assert robot.safety.verdict.reason is Reason.CAMERA
        assert not robot.motors.turning


def test_the_death_of_the_watchdog_stops_the_motors() -> None:
    bomb = Bomb()
    with Watchdog(bomb) as watchdog:
        robot = Driving(subscribers=[watchdog])
        robot.drive_off()
        bomb.lit = True
        robot.stops()
        assert "watchdog thread: KeyError" in robot.safety.verdict.sentence
        assert not robot.motors.turning


def test_the_death_of_the_recorder_stops_the_motors(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("mcap")
    bomb = Bomb()
    subject = Robot(tmp_path / "robot").subject()
    with Recorder(RecordingConfig(str(tmp_path / "drives"), 0.0), subject) as recorder:
        robot = Driving(subscribers=[recorder])
        robot.drive_off()
        monkeypatch.setattr(recorder, "_write", bomb)
        bomb.lit = True
        robot.stops()
        assert robot.safety.verdict.reason is Reason.SUBSCRIBER
        assert recorder.reading().level == "bad"
        assert not robot.motors.turning


def test_the_death_of_the_motors_thread_stops_the_motors() -> None:
    clock, bus, config = MonotonicClock(), VirtualI2cBus(), HatConfig()
    hat = VirtualHat(bus, clock)
    driver = MotorDriver(StepperHat(bus, config, clock), config, clock)
    bomb = Bomb()
    moved = driver._hat.move
    driver._hat.move = lambda steps: (bomb(), moved(steps))[1]  # type: ignore[method-assign]
    with MotorThread(driver, clock) as motors:
        robot = Driving(motors=motors)
        robot.drive_off()
        robot.steps(motors)
        bomb.lit = True
        robot.stops()
        assert robot.safety.verdict.reason is Reason.MOTORS
        assert hat.fields_rad == (None, None), "its coils are off"


def test_a_watchdog_that_hangs_stops_the_motors() -> None:
    hang = threading.Event()
    let_go = threading.Event()

    def look() -> None:
        if hang.is_set():
            let_go.wait()

    with Watchdog(look) as watchdog:
        robot = Driving(subscribers=[watchdog])
        robot.drive_off()
        began_s = time.monotonic()
        hang.set()
        robot.stops()
        assert time.monotonic() - began_s < 1.5
        assert "watchdog thread: expected a look every 0.05 s, it hangs" in (
            robot.safety.verdict.sentence
        )
        assert not robot.motors.turning
        let_go.set()


def test_a_watchdog_that_was_only_paused_with_the_loop_does_not_hang() -> None:
    looked = Bomb()
    watchdog = Watchdog(looked)  # never started: it does not look
    tick = Driving().runtime.step()
    for number in range(5):
        watchdog.on_tick(dataclasses.replace(tick, time_s=100.0 * number))
    with pytest.raises(HardwareError, match="it hangs"):
        watchdog.on_tick(dataclasses.replace(tick, time_s=500.0))


def test_a_motor_thread_that_hangs_stops_the_motors() -> None:
    clock, bus, config = MonotonicClock(), VirtualI2cBus(), HatConfig()
    hat = VirtualHat(bus, clock)
    driver = MotorDriver(StepperHat(bus, config, clock), config, clock)
    with MotorThread(driver, clock) as motors:
        robot = Driving(motors=motors)
        robot.drive_off()
        robot.steps(motors)
        let_go = threading.Event()
        motors._alarm.wait = lambda _=None: let_go.wait()  # type: ignore[method-assign,misc]
        began_s = time.monotonic()
        robot.stops()
        assert time.monotonic() - began_s < 1.5
        assert robot.safety.verdict.reason is Reason.MOTORS
        assert "expected a turn each time it is woken, it hangs" in robot.safety.verdict.sentence
        assert hat.fields_rad == (None, None), "its coils are off"
        let_go.set()


def test_a_motor_thread_that_hangs_while_the_robot_holds_is_a_fault() -> None:
    clock, bus, config = MonotonicClock(), VirtualI2cBus(), HatConfig()
    hat = VirtualHat(bus, clock)
    driver = MotorDriver(StepperHat(bus, config, clock), config, clock)
    with MotorThread(driver, clock) as motors:
        robot = Driving(motors=motors, subscribers=[motors])
        robot.drive_off()
        robot.steps(motors)
        robot.runtime.ask(Command.STOP)
        let_go = threading.Event()
        motors._alarm.wait = lambda _=None: let_go.wait()  # type: ignore[method-assign,misc]
        robot.stops()
        assert "each time it is woken, it hangs" in robot.safety.verdict.sentence
        assert hat.fields_rad == (None, None), "its coils are off"
        let_go.set()


def test_coils_that_another_program_switches_off_while_the_robot_holds_are_a_fault() -> None:
    clock, bus, config = MonotonicClock(), VirtualI2cBus(), HatConfig()
    hat = VirtualHat(bus, clock)
    driver = MotorDriver(StepperHat(bus, config, clock), config, clock)
    with MotorThread(driver, clock) as motors:
        robot = Driving(motors=motors, subscribers=[motors])
        robot.drive_off()
        robot.steps(motors)
        robot.runtime.ask(Command.STOP)
        assert robot.safety.verdict.state is State.HOLD
        bus.write(0x6F, b"\xfd\x10")
        robot.stops()
        assert "another program released or wrote" in robot.safety.verdict.sentence
        assert hat.fields_rad == (None, None)
        robot.runtime.ask(Command.CLEAR)
        assert robot.safety.verdict.state is State.DISARMED
        assert not hat.chip.outputs.any_high, "clearing switches nothing on"


class Counting(Worker):
    def __init__(self) -> None:
        super().__init__("counting")
        self.turns = 0

    def _work(self) -> None:
        while not self._ending.wait(0.001):
            self.turns += 1
            if self.turns == 3:
                raise ValueError("three")


def test_a_worker_begins_anew() -> None:
    worker = Counting()
    worker.check()
    with worker:
        deadline_s = time.monotonic() + 5.0
        while worker.alive:
            assert time.monotonic() < deadline_s
        with pytest.raises(HardwareError, match="counting thread: ValueError"):
            worker.check()
        worker.end()
        worker.start()
        worker.check()
        assert worker.alive
    assert not any(thread.name == "counting" for thread in threading.enumerate())
