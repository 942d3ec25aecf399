"""The runtime on virtual motors: how far the robot still rolls after a fault."""

from __future__ import annotations

from contextlib import suppress
from typing import Tuple

import numpy as np
import pytest

from robot.camera.source import Frame
from robot.contract import CONTROL_DT_S
from robot.errors import HardwareError
from robot.inference.preprocess import FRAME_SHAPE
from robot.runtime.loop import Runtime
from robot.safety.gates import Reason
from robot.safety.state_machine import Command, Safety, State
from sim_pybullet.virtual.i2c import BusFault
from tests.robot.clocks import FakeClock
from tests.robot.fakes import FakePolicy
from tests.robot.hat.rig import Rig, make_rig, speeds
from tests.robot.tiny_onnx import lane_contract


class NoiseCamera:
    """A new picture at each look, until it goes blind."""

    def __init__(self, rig: Rig) -> None:
        self.blind = False
        self._rig, self._rng, self._sequence = rig, np.random.default_rng(0), 0

    def read(self) -> Frame:
        assert not self.blind, "the camera is gone"
        self._sequence += 1
        picture = self._rng.integers(0, 256, FRAME_SHAPE, dtype=np.uint8)
        return Frame(picture, self._sequence, self._rig.clock.now())


def driving_robot() -> Tuple[Rig, NoiseCamera, Runtime]:
    """At 0.3 m/s straight on, by the policy."""
    rig = make_rig()
    camera, safety = NoiseCamera(rig), Safety(rig.clock.now)
    policy = FakePolicy(FakeClock(), lane_contract())
    runtime = Runtime(camera, policy, rig.driver, safety, rig.clock)
    rig.driver.open()
    runtime.step()
    for command in (Command.ARM, Command.AUTO):
        assert runtime.ask(command).accepted
    turn(rig, runtime, 20)
    assert speeds(rig.driver.planner, rig.clock.now()) == pytest.approx((0.3, 0.3))
    return rig, camera, runtime


def turn(rig: Rig, runtime: Runtime, count: int) -> None:
    for _ in range(count):
        runtime.step()
        end_s = rig.clock.now() + CONTROL_DT_S
        with suppress(HardwareError):  # the motor thread keeps it for the next command
            rig.wait(CONTROL_DT_S)
        rig.clock.advance_to(end_s)


def rolled_after(rig: Rig, runtime: Runtime) -> float:
    """How far it rolls from the turn of the fault until it stands [m]."""
    before_m = rig.rolled_m
    turn(rig, runtime, 30)
    assert runtime.safety.verdict.state is State.FAULT
    assert not rig.hat.chip.outputs.any_high
    return max(np.subtract(rig.rolled_m, before_m))


def test_a_fault_brakes_the_robot_before_it_lets_the_wheels_go() -> None:
    rig, camera, runtime = driving_robot()
    camera.blind = True
    assert rolled_after(rig, runtime) < 0.03


def test_a_fault_of_the_bus_can_only_let_the_wheels_go() -> None:
    rig, _, runtime = driving_robot()
    rig.bus.inject(BusFault.NACK)
    rolled_m = rolled_after(rig, runtime)
    assert runtime.safety.verdict.reason is Reason.MOTORS
    assert 0.06 < rolled_m < 0.15
