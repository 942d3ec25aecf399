"""Each part of a robot is given what its configuration says, and is heard."""

from __future__ import annotations

import shutil
import time
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path
from typing import Any, Dict

import numpy as np
import pytest

from robot.camera.source import Frame
from robot.computer.clock import MonotonicClock
from robot.config import RobotConfig
from robot.geometry import Pose
from robot.hat.config import HatConfig
from robot.hat.driver import MotorDriver
from robot.hat.stepper_hat import StepperHat
from robot.hat.thread import MotorThread
from robot.inference.policy import SHIPPED_MODELS
from robot.inference.preprocess import FRAME_SHAPE
from robot.link.keys import keygen
from robot.link.messages import Telemetry
from robot.link.sockets import LinkConfig, OtherRobot, Publisher
from robot.runtime import assemble
from robot.runtime.assemble import open_robot
from robot.runtime.reports import Reporter
from robot.safety.gates import Reason, SafetyLimits
from robot.safety.governors import Rules
from sim_pybullet.virtual.hat import VirtualHat
from sim_pybullet.virtual.i2c import VirtualI2cBus
from tests.robot.fakes import FakeSubscriber, after
from tests.robot.link.conftest import free_base_port, until
from tests.robot.runtime.test_assemble import PATIENT, DarkCamera, RollingMotors
from tests.robot.test_worker import Noise
from tests.robot.tiny_onnx import lane_contract, navigation_contract, write_policy


class CoveredCamera:
    """A hand before the lens."""

    def __init__(self) -> None:
        self._sequence = 0

    def read(self) -> Frame:
        self._sequence += 1
        return Frame(np.zeros(FRAME_SHAPE, np.uint8), self._sequence, time.monotonic())


@pytest.fixture
def lane(tmp_path: Path) -> RobotConfig:
    return RobotConfig(str(write_policy(tmp_path / "lane.onnx", lane_contract())), safety=PATIENT)


def parts(**others: Any) -> Dict[str, Any]:
    made = {"camera": DarkCamera(), "motors": RollingMotors(Pose(0.0, 0.0, 0.0)), **others}
    return {name: nullcontext(part) for name, part in made.items() if part is not None}


def test_limits_and_rules_are_those_of_the_configuration(lane: RobotConfig) -> None:
    limits = SafetyLimits(frame_age_s=0.11, max_wheel_mps=0.1)
    rules, sight = Rules(headway=True), str(SHIPPED_MODELS / "sight.onnx")
    with open_robot(replace(lane, safety=limits, rules=rules, sight=sight), **parts()) as runtime:
        assert runtime.safety.limits == limits
        assert runtime._rules == rules.chain()


def test_pictures_are_doubted(lane: RobotConfig) -> None:
    heard = FakeSubscriber()
    with open_robot(lane, (), (heard,), **parts(camera=CoveredCamera())) as runtime:
        runtime.run(after(8))
    assert heard.ticks[-1].inputs.blind_s > 0.5


def test_the_cameras_clock_is_that_of_the_loop(
    lane: RobotConfig, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(assemble, "open_stream", lambda *_: Noise())
    heard = FakeSubscriber()
    with open_robot(lane, (), (heard,), **parts(camera=None)) as runtime:
        deadline_s = time.monotonic() + 10.0
        while not (heard.ticks and heard.ticks[-1].frame):
            assert time.monotonic() < deadline_s
            runtime.run(after(1))
    assert 0.0 <= heard.ticks[-1].inputs.frame_age_s < 5.0


def test_a_motor_thread_that_hangs_is_heard_of_while_the_robot_rests(lane: RobotConfig) -> None:
    clock, bus, config = MonotonicClock(), VirtualI2cBus(), HatConfig()
    VirtualHat(bus, clock)
    motors = MotorThread(MotorDriver(StepperHat(bus, config, clock), config, clock), clock)
    with open_robot(lane, **{**parts(), "motors": motors}) as runtime:
        runtime.run(after(2))
        motors._alarm.wait = lambda _=None: time.sleep(3.0)  # type: ignore[method-assign,misc]
        runtime.run(after(12))
        assert runtime.safety.verdict.reason in (Reason.SUBSCRIBER, Reason.MOTORS)


def test_who_was_turned_away_is_told_with_the_robots_health(
    lane: RobotConfig, configs: Dict[str, LinkConfig]
) -> None:
    with open_robot(replace(lane, link=configs["robot"]), **parts()) as runtime:
        runtime.run(after(1))
        (told,) = [each.newest for each in runtime._subscribers if isinstance(each, Reporter)]
    assert told is not None
    assert "turned away" in [each.name for each in told.health]


def test_the_navigator_hears_of_every_turn_so_that_a_mission_ends_with_its_drive(
    configs: Dict[str, LinkConfig], tmp_path: Path
) -> None:
    model = write_policy(tmp_path / "nav.onnx", navigation_contract())
    config = RobotConfig(str(model), map="town", link=configs["robot"], safety=PATIENT)
    with open_robot(config, **parts()) as runtime:
        assert runtime._navigator in runtime._subscribers


def test_each_other_robot_is_heard_under_its_own_name_and_address(
    configs: Dict[str, LinkConfig], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    its, own = keygen(tmp_path / "its", ("robot", "monitor"))["robot"], tmp_path / "own"
    shutil.copytree(configs["robot"].keys, own)
    shutil.copy(its / "public.key", own / "allowed" / "rover.key")
    shutil.copy(own / "public.key", its / "allowed" / "robot.key")
    other = OtherRobot("rover", "127.0.0.1", free_base_port())
    link = replace(configs["robot"], keys=str(own), robots=(other,))
    model = str(write_policy(tmp_path / "nav.onnx", navigation_contract()))
    sight, rules = str(SHIPPED_MODELS / "sight.onnx"), Rules(headway=True)
    config = RobotConfig(model, map="town", link=link, sight=sight, rules=rules)
    heard: Dict[str, Any] = {}
    open_navigator = assemble.open_navigator

    def listening(*given: Any) -> Any:
        heard.update(given[-1])
        return open_navigator(*given)

    monkeypatch.setattr(assemble, "open_navigator", listening)
    rover = LinkConfig(str(its), base_port=other.base_port)
    with open_robot(config, **parts()), rover.open() as its_link:
        publisher, got = Publisher(its_link, Telemetry), []

        def arrived() -> bool:
            publisher.send(Telemetry("rover", "AUTO"))
            got.append(heard["rover"]())
            return got[-1] is not None

        assert until(arrived)
    assert list(heard) == ["rover"]
    assert (got[-1].robot, got[-1].state) == ("rover", "AUTO")
