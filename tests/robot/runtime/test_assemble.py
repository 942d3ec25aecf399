"""A whole robot in real time: link, navigator and policy, on made-up camera and wheels."""

from __future__ import annotations

import math
import threading
import time
from contextlib import closing, contextmanager, nullcontext
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Callable, Dict, Iterator, List, Optional

import numpy as np
import pytest

from robot.camera.source import CAPTURE_PX, Frame, NewestFrame, open_stream
from robot.config import CameraConfig, RecordingConfig, RobotConfig
from robot.contract import DRIVE
from robot.errors import ConfigError, HardwareError
from robot.geometry import Pose, WheelSpeeds
from robot.inference.policy import SHIPPED_MODELS
from robot.link.command_client import CommandClient
from robot.link.messages import (
    Ack,
    InputAge,
    Mission,
    PosesMessage,
    Sighting,
    Telemetry,
    told_age,
)
from robot.link.sockets import LinkConfig, OtherRobot, Publisher, Subscriber
from robot.navigation.planner import plan_path
from robot.navigation.road_map import load_map
from robot.recording import topics
from robot.recording.reader import entries
from robot.runtime.assemble import open_robot
from robot.runtime.loop import Runtime
from robot.safety.gates import Reason, SafetyLimits
from robot.safety.governors import Rules
from robot.safety.state_machine import Command, State
from tests.robot.fakes import FakeOperator, FakeSubscriber, after
from tests.robot.navigation.test_navigator import GRAPH
from tests.robot.tiny_onnx import lane_contract, navigation_contract, write_policy

SIGHT = SHIPPED_MODELS / "sight.onnx"
# The computers that run the tests may be busy; what is tested here is the wiring, not the limits.
PATIENT = SafetyLimits(frame_age_s=2.0, loop_age_s=2.0, link_age_s=0.6, pose_age_s=2.0)


class DarkCamera:
    """The tiny policy steers by the path alone on dark pictures; faint blotches pass by."""

    def __init__(self) -> None:
        self._sequence = 0
        blotches = np.random.default_rng(0).integers(0, 2, (6, 8, 1), np.uint8) * 14
        self._scene = blotches.repeat(20, axis=0).repeat(20, axis=1).repeat(3, axis=2)

    def read(self) -> Frame:
        self._sequence += 1
        picture = np.roll(self._scene, 4 * self._sequence, axis=1)
        return Frame(picture, self._sequence, time.monotonic())


class RollingMotors:
    """Wheels that roll as told, by the clock; ``pose`` is where they have come."""

    def __init__(self, start: Pose) -> None:
        self._pose, self._wheels, self._rolled_s = start, WheelSpeeds(0.0, 0.0), time.monotonic()

    @property
    def pose(self) -> Pose:
        now_s = time.monotonic()
        twist, dt_s = DRIVE.twist(self._wheels), now_s - self._rolled_s
        self._pose = self._pose.moved(twist.forward_mps * dt_s, twist.turn_radps * dt_s)
        self._rolled_s = now_s
        return self._pose

    def set_wheels(self, wheels: WheelSpeeds) -> None:
        _ = self.pose
        self._wheels = wheels

    def stop(self) -> None:
        self.set_wheels(WheelSpeeds(0.0, 0.0))

    def release(self) -> None:
        self.stop()

    def mend(self) -> None:
        pass

    @property
    def rolling(self) -> bool:
        return self._wheels != WheelSpeeds(0.0, 0.0)


class Overhead:
    """Localizer and operator in one thread of the test."""

    def __init__(self, links: Dict[str, LinkConfig], motors: RollingMotors) -> None:
        self._localizer, self._monitor = links["localizer"].open(), links["monitor"].open()
        self._poses = Publisher(self._localizer, PosesMessage)
        self._client = CommandClient(self._monitor)
        self._reports = Subscriber(self._monitor, Telemetry)
        self._motors = motors
        self.report: Optional[Telemetry] = None
        self.acks: List[Ack] = []
        self.beating = True

    def ask(self, kind: str, mission: Optional[Mission] = None) -> Ack:
        wanted = self._client.send(kind, mission)
        self.until(lambda: any(ack.id == wanted for ack in self.acks))
        return next(ack for ack in self.acks if ack.id == wanted)

    def until(self, holds: Callable[[], bool], patience_s: float = 15.0) -> None:
        deadline_s = time.monotonic() + patience_s
        while not holds():
            assert time.monotonic() < deadline_s, f"waited in vain; last report: {self.report}"
            pose, now_s = self._motors.pose, time.monotonic()
            self._poses.send(PosesMessage((Sighting("robot", *pose, 0.9),), now_s))
            self.acks += self._client.poll(self.beating)
            self.report = self._reports.receive() or self.report
            time.sleep(0.02)

    def met(self) -> bool:
        """The robot has heard us and the localizer, and we have heard the robot."""
        told = self.report is not None and self.report.pose is not None
        return told and self._client.silence_s() < 0.5

    def state(self) -> str:
        return self.report.state if self.report else ""

    def close(self) -> None:
        self._localizer.close()
        self._monitor.close()


@contextmanager
def running(runtime: Runtime) -> Iterator[None]:
    """The loop in a thread, as on the robot's main one."""
    ended = threading.Event()
    thread = threading.Thread(target=lambda: runtime.run(ending=ended.is_set))
    thread.start()
    try:
        yield
    finally:
        ended.set()
        thread.join()


def test_a_mission_from_the_monitor_to_the_wheels(
    tmp_path: Path, configs: Dict[str, LinkConfig]
) -> None:
    lane = next(lane for lane in GRAPH.lanes if _is_straight(np.asarray(lane.control_points_m)))
    a, b = np.asarray(lane.control_points_m)[[0, 3]]
    start = Pose(*a, math.atan2(*(b - a)[::-1]))
    goal = (float(b[0]), float(b[1]))
    assert plan_path(load_map("town"), start, goal).length_m > 0.4
    motors = RollingMotors(start)
    model = write_policy(tmp_path / "nav.onnx", navigation_contract())
    config = RobotConfig(str(model), map="town", link=configs["robot"], safety=PATIENT)
    with closing(Overhead(configs, motors)) as overhead, open_robot(
        config, camera=nullcontext(DarkCamera()), motors=nullcontext(motors)
    ) as runtime, running(runtime):
        overhead.until(overhead.met)
        refused = overhead.ask("mission", Mission(goal))
        assert not refused.accepted
        assert "not possible in DISARMED" in refused.reason
        overhead.until(lambda: overhead.ask("arm").accepted)  # once it has heard a sign of life
        assert overhead.ask("mission", Mission(goal)).accepted
        overhead.until(lambda: motors.rolling)
        overhead.until(lambda: overhead.state() == "HOLD")
        assert overhead.report is not None
        assert overhead.report.mission is not None
        assert overhead.report.mission.phase == "arrived"
        assert math.hypot(motors.pose.x_m - goal[0], motors.pose.y_m - goal[1]) < 0.1
        assert not motors.rolling
        # Again, but this time the operator's machine falls silent under way.
        assert overhead.ask("arm").accepted
        assert overhead.ask("stop").accepted
        assert overhead.ask("arm").accepted
        overhead.until(lambda: overhead.state() == "READY")
        overhead.beating = False
        overhead.until(lambda: overhead.state() == "HOLD")
        assert runtime.safety.verdict.reason is Reason.LINK_LOST
    assert runtime.safety.verdict.state is State.DISARMED


def _is_straight(control: np.ndarray) -> bool:
    chord = control[3] - control[0]
    along = control[1] - control[0]
    return abs(float(chord[0] * along[1] - chord[1] * along[0])) < 1e-9


def test_a_lane_policy_without_a_link_is_driven_from_the_terminal(tmp_path: Path) -> None:
    model = write_policy(tmp_path / "lane.onnx", lane_contract())
    motors = RollingMotors(Pose(0.0, 0.0, 0.0))
    operator, heard = FakeOperator(), FakeSubscriber()
    operator.silent_s = None
    parts = {"camera": nullcontext(DarkCamera()), "motors": nullcontext(motors)}
    config = RobotConfig(str(model), recording=RecordingConfig(str(tmp_path / "drives"), 0.0))
    with open_robot(config, (operator,), (heard,), **parts) as runtime:
        runtime.run(after(2))
        operator.wishes = [(Command.ARM, None)]
        runtime.run(after(2))
    assert len(heard.ticks) == 4
    assert heard.ticks[-1].inputs.link_age_s is None
    (path,) = (tmp_path / "drives").iterdir()
    reports = [entry.message() for entry in entries(path, topics.TELEMETRY)]
    assert [report["state"] for report in reports] == ["READY", "READY"]
    assert "recorded" in [reading["name"] for reading in reports[-1]["health"]]


def test_names_and_silences_of_any_length_are_told(tmp_path: Path) -> None:
    """Longer ones than a report takes kept a robot from starting, or put it into FAULT."""
    model = write_policy(tmp_path / f"{'lane' * 20}.onnx", lane_contract())
    parts = {
        "camera": nullcontext(DarkCamera()),
        "motors": nullcontext(RollingMotors(Pose(0.0, 0.0, 0.0))),
    }
    with open_robot(RobotConfig(str(model)), (FakeOperator(),), **parts) as runtime:
        runtime.run(after(1))
    days_s = 12.0 * 24.0 * 3600.0
    assert InputAge("frame", told_age(days_s), 0.3).age_s == 1e6
    assert told_age(-1.0) == 0.0
    assert told_age(math.inf) is None


def test_a_lane_keeper_stands_for_what_its_pictures_show(tmp_path: Path) -> None:
    lane = str(write_policy(tmp_path / "lane.onnx", lane_contract()))
    operator, heard = FakeOperator(), FakeSubscriber()
    operator.silent_s = None
    parts = {
        "camera": nullcontext(DarkCamera()),
        "motors": nullcontext(RollingMotors(Pose(0.0, 0.0, 0.0))),
    }
    config = RobotConfig(lane, sight=str(SIGHT), safety=PATIENT, rules=Rules(headway=True))
    with open_robot(config, (operator,), (heard,), **parts) as runtime:
        for word in (Command.ARM, Command.AUTO):
            runtime.run(after(3))
            operator.wishes = [(word, None)]
        runtime.run(after(1))
    tick = heard.ticks[-1]
    assert tick.guidance is not None
    assert (tick.guidance.path, tick.guidance.pose) == (None, None)
    assert not math.isnan(tick.guidance.ahead.free_m), "it was asked about this very picture"


def test_a_lane_keeper_obeys_no_rule_that_it_cannot_see_to(
    tmp_path: Path, configs: Dict[str, LinkConfig]
) -> None:
    lane = str(write_policy(tmp_path / "lane.onnx", lane_contract()))
    config = RobotConfig(lane, map="town", link=configs["robot"], rules=Rules(stop_lines=True))
    with pytest.raises(ConfigError, match="rules: expected headway at most"):
        open_robot(config).__enter__()
    parts = {
        "camera": nullcontext(DarkCamera()),
        "motors": nullcontext(RollingMotors(Pose(0.0, 0.0, 0.0))),
    }
    with pytest.raises(ConfigError, match=r"rules\.headway: expected sight as well"):
        open_robot(replace(config, rules=Rules(headway=True)), **parts).__enter__()


def test_a_robot_that_shall_hear_another_must_know_its_key(
    tmp_path: Path, configs: Dict[str, LinkConfig]
) -> None:
    model = str(write_policy(tmp_path / "nav.onnx", navigation_contract()))
    link = replace(configs["robot"], robots=(OtherRobot("robot2", "127.0.0.1"),))
    rules = Rules(True, True, True)
    config = RobotConfig(model, map="town", sight=str(SIGHT), link=link, rules=rules)
    parts = {
        "camera": nullcontext(DarkCamera()),
        "motors": nullcontext(RollingMotors(Pose(0.0, 0.0, 0.0))),
    }
    with pytest.raises(ConfigError, match=r"expected a robot's in allowed/robot2\.key, got none"):
        open_robot(config, **parts).__enter__()


def test_a_robot_without_its_watchdog_does_not_drive(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def broken(_: Runtime) -> None:
        raise KeyError("bug")

    monkeypatch.setattr(Runtime, "watch", broken)
    model = write_policy(tmp_path / "lane.onnx", lane_contract())
    parts = {
        "camera": nullcontext(DarkCamera()),
        "motors": nullcontext(RollingMotors(Pose(0.0, 0.0, 0.0))),
    }
    with open_robot(RobotConfig(str(model)), **parts) as runtime:
        runtime.run(after(3))
        assert runtime.safety.verdict.state is State.FAULT
        assert "watchdog thread: KeyError" in runtime.safety.verdict.sentence


def test_what_is_missing_is_said_before_anything_moves(tmp_path: Path) -> None:
    model = write_policy(tmp_path / "nav.onnx", navigation_contract())
    with pytest.raises(ConfigError, match="expected the map to navigate on"):
        open_robot(RobotConfig(str(model))).__enter__()
    lane = write_policy(tmp_path / "lane.onnx", lane_contract())
    with pytest.raises(HardwareError, match="/dev/i2c-"):
        open_robot(RobotConfig(str(lane)), camera=nullcontext(DarkCamera())).__enter__()


def test_each_kind_of_camera_opens_in_a_block(tmp_path: Path) -> None:
    sockets = {"path": str(tmp_path / "none")}
    for kind, more in (("csi", {}), ("v4l2", {}), ("socket", sockets)):
        config = CameraConfig(kind, number=977, **more)
        with NewestFrame(partial(open_stream, config, CAPTURE_PX), time.monotonic) as camera:
            assert isinstance(camera, NewestFrame)
            assert camera.read() is None
