"""Each part of a robot is given what its configuration says, and is heard."""

from __future__ import annotations

import shutil
import time
from contextlib import ExitStack, nullcontext
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any, Dict, List

import numpy as np
import pytest

from robot.camera.source import Frame
from robot.computer.clock import MonotonicClock
from robot.config import CameraConfig, RecordingConfig, RobotConfig
from robot.errors import ContractError
from robot.geometry import Pose
from robot.hat.config import HatConfig
from robot.hat.driver import MotorDriver
from robot.hat.stepper_hat import StepperHat
from robot.hat.thread import MotorThread
from robot.inference.policy import SHIPPED_MODELS
from robot.inference.preprocess import FRAME_SHAPE
from robot.lens import CameraRig, Mount
from robot.link.keys import keygen
from robot.link.messages import Belief, FrameMessage, MissionStatus, PoseMessage, Telemetry
from robot.link.sockets import LinkConfig, OtherRobot, Publisher
from robot.runtime import assemble
from robot.runtime.assemble import open_robot
from robot.runtime.reports import Reporter
from robot.safety.gates import Reason, SafetyLimits
from robot.safety.governors import Rules
from robot.vision.road_fit import RoadFit
from sim_pybullet.virtual.hat import VirtualHat
from sim_pybullet.virtual.i2c import VirtualI2cBus
from tests.robot.fakes import FakeSubscriber, after
from tests.robot.link.conftest import free_base_port, until
from tests.robot.runtime.test_assemble import PATIENT, DarkCamera, RollingMotors
from tests.robot.runtime.test_loop import Bench
from tests.robot.test_worker import Noise
from tests.robot.tiny_onnx import lane_contract, navigation_contract, write_policy

LINK = LinkConfig("keys")
ACTIONS = ((0.1, 0.2), (0.15, 0.2), (0.2, 0.2), (0.2, 0.15), (0.2, 0.1))


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


def test_the_camera_is_the_configured_one_and_its_clock_is_that_of_the_loop(
    lane: RobotConfig, monkeypatch: pytest.MonkeyPatch
) -> None:
    opened: List[Any] = []
    monkeypatch.setattr(assemble, "open_stream", lambda *told: opened.append(told) or Noise())
    heard, config = FakeSubscriber(), replace(lane, camera=CameraConfig("v4l2", number=3))
    with open_robot(config, (), (heard,), **parts(camera=None)) as runtime:
        deadline_s = time.monotonic() + 10.0
        while not (heard.ticks and heard.ticks[-1].frame):
            assert time.monotonic() < deadline_s
            runtime.run(after(1))
    assert 0.0 <= heard.ticks[-1].inputs.frame_age_s < 5.0
    assert opened[0] == (config.camera, (320, 240))
    assert 0.0 <= time.monotonic() - runtime.safety.verdict.since_s < 60.0


def test_pictures_are_held_against_the_road_as_this_camera_and_this_map_have_it(
    lane: RobotConfig, configs: Dict[str, LinkConfig], monkeypatch: pytest.MonkeyPatch
) -> None:
    camera, made = CameraConfig(mount=Mount(height_m=0.12, pitch_rad=0.3)), []

    def road_fit(*given: Any) -> RoadFit:
        made.append((given, RoadFit(*given)))
        return made[-1][1]

    monkeypatch.setattr(assemble, "RoadFit", road_fit)
    for name, link in (("", None), ("town", configs["robot"])):
        with open_robot(replace(lane, camera=camera, map=name, link=link), **parts()) as runtime:
            ((rig, paint), fit) = made[-1]
            assert runtime._eyes is not None
            assert runtime._eyes._road is fit
        assert rig == CameraRig(camera.lens, camera.mount)
        assert (paint is not None) is bool(name), "the paint of a map, where there is one"


def test_a_translator_that_is_named_is_opened(lane: RobotConfig) -> None:
    with pytest.raises(ContractError, match=r"none\.onnx"):
        open_robot(replace(lane, translator="none.onnx"), **parts()).__enter__()


@pytest.mark.parametrize("sight", ["", str(SHIPPED_MODELS / "sight.onnx")])
@pytest.mark.parametrize("rules", [Rules(), Rules(stop_lines=True), Rules(headway=True)])
@pytest.mark.parametrize("reports", [{}, {"rover": lambda: None}])
def test_the_navigator_is_this_robots_with_the_sight_and_the_rules_that_it_has(
    sight: str, rules: Rules, reports: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    made: Dict[str, Any] = {}
    for part in ("MissionNavigator", "RoadWatch", "Neighbours", "Company"):
        monkeypatch.setattr(assemble, part, lambda *given, part=part: made.setdefault(part, given))
    motors = RollingMotors(Pose(1.0, 2.0, 0.5))
    config = RobotConfig("m", name="daisy", map="town", sight=sight, rules=rules, link=LINK)
    assemble.open_navigator(config, list, motors, DarkCamera(), reports)  # type: ignore[arg-type]
    _, receive, odometry, name, glimpse, watch = made["MissionNavigator"]
    assert (receive, odometry(), name) == (list, motors.pose, "daisy")
    assert (glimpse is not None) is bool(sight)
    assert watch == made.get("RoadWatch"), "without any rule nobody looks at the road"
    assert (watch is not None) is (rules != Rules())
    others = made.get("Company" if reports else "Neighbours")
    assert (others is not None) is (rules.headway or bool(reports))
    assert others is None or others[1] == "daisy", "or it would stand for itself"
    assert not reports or others[2] is reports
    if watch is not None:
        assert watch[1] is others
        assert (watch[2] is not None) is bool(others and sight), "the way is seen as well"


def test_a_lane_keeper_counts_by_its_own_wheels_how_near_a_thing_has_come(
    lane: RobotConfig, monkeypatch: pytest.MonkeyPatch
) -> None:
    motors, sight = RollingMotors(Pose(1.0, 2.0, 0.5)), str(SHIPPED_MODELS / "sight.onnx")
    monkeypatch.setattr(assemble, "LaneWatch", lambda *told: told)
    config = replace(lane, sight=sight, rules=Rules(headway=True))
    _, odometry = assemble.open_watch(config, motors, DarkCamera())  # type: ignore[misc]
    assert odometry() == motors.pose


def test_a_turn_is_recorded_with_its_own_report_and_what_the_localizer_said(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    bench, heard = Bench(), []
    monkeypatch.setattr(
        assemble,
        "Recorder",
        lambda _, subject: nullcontext(
            SimpleNamespace(on_tick=lambda tick: heard.append(subject.hear(tick)), reading=None)
        ),
    )
    monkeypatch.setattr(assemble, "Health", lambda *_: SimpleNamespace(readings=tuple))
    belief, status = Belief(0.2, 0.1, 0.0, 0.1, "sight"), MissionStatus("m1", (1.0, 2.0))
    navigator: Any = SimpleNamespace(
        overhead=PoseMessage("daisy", 1.0, 2.0, 0.5, 0.9, 3.0),
        path_points=((0.0, 0.0), (1.0, 2.0)),
        status=status,
        belief={bench.clock.now(): belief}.get,
    )
    motors: Any = SimpleNamespace(pose=Pose(3.0, 4.0, 0.25))
    config = RobotConfig(
        "models/mine.onnx",
        name="daisy",
        map="town",
        link=LINK,
        recording=RecordingConfig("drives"),
        safety=SafetyLimits(frame_age_s=0.11),
    )
    told = assemble.open_reports(
        config, lane_contract(actions=ACTIONS), None, navigator, motors, ExitStack()
    )
    tick = bench.runtime.step()
    for each in told:
        each.on_tick(tick)
    ((of, odometry, report, overhead),) = heard
    assert (of, odometry, overhead) == (tick, motors.pose, navigator.overhead)
    assert report is not None
    assert (report.robot, report.model, report.map) == ("daisy", "mine", "town")
    assert (report.state, report.actions) == (tick.verdict.state.value, ACTIONS)
    assert (report.belief, report.mission, report.path) == (belief, status, navigator.path_points)
    assert [each.limit_s for each in report.inputs if each.name == "camera"] == [0.11]


def test_a_motor_thread_that_hangs_is_heard_of_while_the_robot_rests(lane: RobotConfig) -> None:
    clock, bus, config = MonotonicClock(), VirtualI2cBus(), HatConfig()
    VirtualHat(bus, clock)
    motors = MotorThread(MotorDriver(StepperHat(bus, config, clock), config, clock), clock)
    with open_robot(lane, **{**parts(), "motors": motors}) as runtime:
        runtime.run(after(2))
        motors._alarm.wait = lambda _=None: time.sleep(3.0)  # type: ignore[method-assign,misc]
        runtime.run(after(12))
        assert runtime.safety.verdict.reason in (Reason.SUBSCRIBER, Reason.MOTORS)


def test_who_was_turned_away_is_told_with_the_robots_health_and_pictures_are_shown(
    lane: RobotConfig, configs: Dict[str, LinkConfig], monkeypatch: pytest.MonkeyPatch
) -> None:
    kinds: List[type] = []
    monkeypatch.setattr(
        assemble.sockets,
        "Publisher",
        lambda link, kind: kinds.append(kind) or Publisher(link, kind),
    )
    with open_robot(replace(lane, link=configs["robot"]), **parts()) as runtime:
        runtime.run(after(1))
        (told,) = [each.newest for each in runtime._subscribers if isinstance(each, Reporter)]
    assert told is not None
    assert "turned away" in [each.name for each in told.health]
    assert {Telemetry, FrameMessage} <= set(kinds)


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
