from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any, Callable, List, Optional, Tuple

import numpy as np
import pytest

from robot.errors import DuckpilotError
from robot.geometry import STILL, WheelSpeeds
from robot.link.messages import KINDS, Command, FrameMessage, Mission, Telemetry
from robot.runtime.remote import RemoteOperator
from robot.runtime.reports import Reporter
from robot.safety.gates import SafetyLimits
from robot.safety.state_machine import Answer, State
from robot.safety.state_machine import Command as Request
from tests.robot.navigation.test_navigator import GOAL, World, driving
from tests.robot.navigation.test_sight_fix import seeing
from tests.robot.runtime.test_loop import FAULTS, Bench, heal


class FakeServer:
    """Hands over commands as the link does, and keeps the answers."""

    def __init__(self) -> None:
        self.waiting: List[Command] = []
        self.refusals: List[str] = []

    def serve(self, handle: Callable[[Command], None]) -> None:
        waiting, self.waiting = self.waiting, []
        for command in waiting:
            try:
                handle(command)
                self.refusals.append("")
            except DuckpilotError as error:
                self.refusals.append(str(error))

    def operator_age_s(self) -> float:
        return 0.25


def command(kind: str, mission: Any = None, wheels: Any = None) -> Command:
    return Command("1" * 16, "2" * 16, kind, mission, wheels)


class Asked:
    def __init__(self, answer: Answer = Answer(True, "")) -> None:  # noqa: B008
        self.requests: List[Tuple[Request, Optional[WheelSpeeds]]] = []
        self.answer = answer

    def __call__(self, request: Request, wheels: Optional[WheelSpeeds]) -> Answer:
        self.requests.append((request, wheels))
        return self.answer


def test_every_kind_of_the_link_is_a_request() -> None:
    server, asked, world = FakeServer(), Asked(), seeing()
    operator = RemoteOperator(server, world.navigator)
    for kind in KINDS:
        if kind not in ("beat", "auto"):
            start = world.pose[:2] if kind == "place" else None
            mission = Mission(GOAL, start) if kind in ("plan", "mission", "place") else None
            server.waiting.append(command(kind, mission))
    operator.serve(asked)
    assert server.refusals == [""] * (len(KINDS) - 2)
    assert {request for request, _ in asked.requests} == set(Request)
    assert operator.age_s() == 0.25


def test_who_keeps_its_lane_is_let_go_and_who_navigates_wants_a_mission() -> None:
    server, asked = FakeServer(), Asked()
    server.waiting = [command("auto")]
    RemoteOperator(server, None).serve(asked)
    assert asked.requests == [(Request.AUTO, None)]
    server.waiting = [command("auto")]
    RemoteOperator(server, driving().navigator).serve(asked)
    assert len(asked.requests) == 1
    assert server.refusals[0] == ""
    assert "expected a mission" in server.refusals[1]


@pytest.mark.parametrize("searches", [True, False])
def test_who_looks_for_its_place_is_let_go_without_a_mission(searches: bool) -> None:
    server, asked, navigator = FakeServer(), Asked(), SimpleNamespace(searches=searches)
    server.waiting = [command("auto")]
    RemoteOperator(server, navigator).serve(asked)  # type: ignore[arg-type]
    assert asked.requests == ([(Request.AUTO, None)] if searches else [])


def test_a_manual_command_turns_its_wheels() -> None:
    server, asked = FakeServer(), Asked()
    server.waiting = [command("manual", wheels=(0.1, -0.2)), command("manual")]
    RemoteOperator(server, None).serve(asked)
    assert asked.requests == [(Request.MANUAL, WheelSpeeds(0.1, -0.2)), (Request.MANUAL, STILL)]


def test_refusals_go_back_with_their_reason() -> None:
    server, asked = FakeServer(), Asked(Answer(False, "arm is refused: no frame"))
    server.waiting = [command("arm"), command("mission", Mission(GOAL))]
    RemoteOperator(server, None).serve(asked)
    assert server.refusals[0] == "arm is refused: no frame"
    assert "lane policy, which knows no destination" in server.refusals[1]
    assert [request for request, _ in asked.requests] == [Request.ARM]


def test_a_mission_that_may_not_start_has_failed() -> None:
    world = driving()
    server, asked = FakeServer(), Asked(Answer(False, "auto is not possible in DISARMED"))
    server.waiting = [command("mission", Mission(GOAL))]
    RemoteOperator(server, world.navigator).serve(asked)
    assert world.navigator.status is not None
    assert world.navigator.status.phase == "failed"
    assert "DISARMED" in world.navigator.status.reason


def test_a_mission_has_the_id_of_the_command_that_began_it() -> None:
    world, server = driving(), FakeServer()
    server.waiting = [command("mission", Mission(GOAL))]
    RemoteOperator(server, world.navigator).serve(Asked())
    assert world.navigator.status is not None
    assert world.navigator.status.id == "1" * 16


def test_a_mission_that_cannot_be_planned_asks_for_nothing() -> None:
    server, asked = FakeServer(), Asked()
    server.waiting = [command("mission", Mission((900.0, 900.0)))]
    RemoteOperator(server, World(driving().pose).navigator).serve(asked)
    assert "expected an overhead pose" in server.refusals[0]
    assert asked.requests == []


def away(world: World, forward_m: float) -> Tuple[float, float]:
    assert world.navigator.pose is not None
    x_m, y_m = world.navigator.pose.to_world([forward_m, 0.0])
    return float(x_m), float(y_m)


@pytest.mark.parametrize("kind", ["plan", "mission"])
@pytest.mark.parametrize(("forward_m", "taken"), [(0.0, True), (0.149, True), (0.151, False)])
def test_a_mission_from_a_start_is_for_a_robot_that_is_there(
    kind: str, forward_m: float, taken: bool
) -> None:
    world = driving()
    world.navigator.end("stopped")
    server, asked = FakeServer(), Asked()
    server.waiting = [command(kind, Mission(GOAL, away(world, forward_m)))]
    RemoteOperator(server, world.navigator).serve(asked)
    requests = [request for request, _ in asked.requests]
    if taken:
        assert server.refusals == [""]
        assert requests == ([Request.AUTO] if kind == "mission" else [])
    else:
        assert "within 15 cm of the mission's start" in server.refusals[0]
        assert "it is 0.15 m from there; put it there" in server.refusals[0]
        assert requests == []
        assert world.navigator.status is not None
        assert world.navigator.status.phase == "stopped", "no mission has begun"


def test_a_robot_is_placed_where_a_person_drags_from_looking_along_it() -> None:
    world = seeing()
    world.navigator.end("stopped")
    server, asked = FakeServer(), Asked()
    ahead = (world.pose.x_m + math.cos(1.0), world.pose.y_m + math.sin(1.0))
    server.waiting = [command("place", Mission(ahead, world.pose[:2]))]
    world.navigator._driving = False
    RemoteOperator(server, world.navigator).serve(asked)
    assert server.refusals == [""]
    assert world.navigator.pose == pytest.approx((*world.pose[:2], 1.0))
    assert asked.requests == [], "nothing moves by that"


def test_how_far_the_robot_is_from_the_start_is_told() -> None:
    world = driving()
    server, asked = FakeServer(), Asked()
    server.waiting = [command("mission", Mission(GOAL, away(world, -1.28)))]
    RemoteOperator(server, world.navigator).serve(asked)
    assert "it is 1.28 m from there" in server.refusals[0]
    assert asked.requests == []


def test_a_plan_changes_nothing_and_is_refused_as_its_mission_would_be() -> None:
    world = driving()
    before = (world.navigator.status, world.navigator.path_points)
    server, asked = FakeServer(), Asked(Answer(False, "never asked"))
    far = Mission((900.0, 900.0))
    server.waiting = [command("plan", Mission(GOAL)), command("plan", far)]
    RemoteOperator(server, world.navigator).serve(asked)
    assert server.refusals[0] == ""
    assert "expected the goal on the road" in server.refusals[1]
    assert asked.requests == []
    assert (world.navigator.status, world.navigator.path_points) == before
    server.waiting = [command("mission", far)]
    RemoteOperator(server, world.navigator).serve(asked)
    assert server.refusals[2] == server.refusals[1]


class Wire:
    """Keeps what is published, as bytes that must survive the way."""

    def __init__(self) -> None:
        self.reports: List[Telemetry] = []
        self.pictures: List[FrameMessage] = []

    def publish(self, report: Telemetry) -> None:
        self.reports.append(Telemetry.from_bytes(report.to_bytes()))

    def show(self, picture: FrameMessage) -> None:
        self.pictures.append(FrameMessage.from_bytes(picture.to_bytes()))


def feed(wire: Wire, world: Optional[World] = None) -> Reporter:
    about = Telemetry("robot", "DISARMED", model="lane_dueling", map="town")
    navigator = world.navigator if world else None
    return Reporter(wire.publish, wire.show, about, SafetyLimits(), navigator)


@pytest.mark.parametrize("name", FAULTS)
def test_every_turn_can_be_told(name: str) -> None:
    bench, wire = Bench().drive(), Wire()
    subscriber = feed(wire)
    subscriber.on_tick(bench.runtime.step())
    assert (wire.reports[-1].state, wire.reports[-1].action) == ("AUTO", 2)
    FAULTS[name][1](bench)
    tick = bench.runtime.step()
    subscriber.on_tick(tick)
    report = wire.reports[-1]
    assert report.state == tick.verdict.state.value
    assert report.reason
    if tick.verdict.state in (State.HOLD, State.FAULT):
        assert report.action is None
    heal(bench)


def test_the_report_tells_mission_and_ages() -> None:
    world, wire, bench = driving(), Wire(), Bench()
    bench.navigator.guidance = world.guidance._replace(pose_age_s=math.inf)
    feed(wire, world).on_tick(bench.runtime.step())
    report = wire.reports[0]
    assert (report.model, report.map) == ("lane_dueling", "town")
    assert report.mission is not None
    assert report.mission.destination == pytest.approx(GOAL)
    assert len(report.path) > 2
    assert report.pose == pytest.approx(tuple(world.pose), abs=0.02)
    ages = {each.name: each.age_s for each in report.inputs}
    assert ages["pose"] is None
    assert ages["operator"] == pytest.approx(0.1)
    assert ages["camera"] is not None


def test_each_picture_is_shown_once_and_the_rate_is_told() -> None:
    bench, wire = Bench(), Wire()
    subscriber = feed(wire)
    frame = bench.camera.read()
    for _ in range(3):
        subscriber.on_tick(bench.runtime.step())
        bench.clock.now_s += 0.09
    assert len(wire.pictures) == 3
    assert [each.t_capture_s for each in wire.pictures] == pytest.approx([999.98, 1000.08, 1000.18])
    assert wire.reports[-1].fps == pytest.approx(10.0, rel=0.05)
    bench.camera.broken = lambda new: frame and frame._replace(time_s=new.time_s)
    for _ in range(3):
        subscriber.on_tick(bench.runtime.step())
    assert len(wire.pictures) == 4


def test_the_picture_looks_like_the_frame() -> None:
    import cv2

    bench, wire = Bench(), Wire()
    plain = np.full((120, 160, 3), (200, 40, 90), np.uint8)
    bench.camera.broken = lambda frame: frame._replace(image=plain)
    feed(wire).on_tick(bench.runtime.step())
    picture = cv2.imdecode(np.frombuffer(wire.pictures[0].jpeg, np.uint8), cv2.IMREAD_COLOR)
    assert np.abs(picture[..., ::-1].astype(int) - plain).max() <= 4
