"""Commands: each done once, old ones refused, STOP repeated until it is acked."""

from __future__ import annotations

import contextlib
import time
from dataclasses import replace
from pathlib import Path
from typing import Callable, Dict

import pytest

from robot.errors import PlanError
from robot.link.command_client import CommandClient
from robot.link.command_server import CommandServer
from robot.link.keys import keygen, load_keys
from robot.link.messages import MAX_ECHO_AGE_S, Ack, Command, Mission
from robot.link.sockets import Link, LinkConfig
from tests.robot.link.conftest import until

zmq = pytest.importorskip("zmq")

Open = Callable[[LinkConfig], Link]
Configs = Dict[str, LinkConfig]


class Robot:
    """Notes what it was asked; refuses missions to the west."""

    def __init__(self, server: CommandServer) -> None:
        self.server = server
        self.asked: list[Command] = []

    def handle(self, command: Command) -> None:
        self.asked.append(command)
        if command.mission is not None and command.mission.destination[0] < 0:
            raise PlanError("the destination is off\nthe road")

    def kinds(self) -> list[str]:
        return [command.kind for command in self.asked]


class Operator:
    """Collects the answers."""

    def __init__(self, client: CommandClient, robot: Robot | None) -> None:
        self.client = client
        self.robot = robot
        self.answers: dict[str, Ack] = {}

    def turn(self) -> None:
        if self.robot is not None:
            self.robot.server.serve(self.robot.handle)
        self.answers.update({ack.id: ack for ack in self.client.poll()})

    def answer(self, command_id: str) -> Ack:
        def answered() -> bool:
            self.turn()
            return command_id in self.answers

        assert until(answered)
        return self.answers[command_id]

    def connected(self) -> bool:
        self.turn()
        return self.client.silence_s() < 0.1


@pytest.fixture
def operator(configs: Configs, open_link: Open) -> Operator:
    robot, monitor = configs["robot"], configs["monitor"]
    server = CommandServer(open_link(robot))
    operator = Operator(CommandClient(open_link(monitor)), Robot(server))
    assert until(operator.connected)
    return operator


def asked(operator: Operator) -> list[str]:
    assert operator.robot is not None
    return operator.robot.kinds()


def test_a_command_is_done_and_answered(operator: Operator) -> None:
    for kind in ("arm", "disarm", "stop", "clear"):
        assert operator.answer(operator.client.send(kind)).accepted
    assert operator.answer(operator.client.send("manual", wheels=(0.3, -0.1))).accepted
    assert operator.answer(operator.client.send("mission", Mission((1.0, 2.0)))).accepted
    assert asked(operator) == ["arm", "disarm", "stop", "clear", "manual", "mission"]


def test_a_refusal_carries_the_reason_on_one_line(operator: Operator) -> None:
    ack = operator.answer(operator.client.send("mission", Mission((-1.0, 2.0))))
    assert not ack.accepted
    assert ack.reason == "the destination is off the road"


def test_the_same_command_twice_is_done_once_and_answered_twice(
    configs: Configs, open_link: Open
) -> None:
    robot, monitor = configs["robot"], configs["monitor"]
    server = CommandServer(open_link(robot))
    body = Robot(server)
    raw = open_link(monitor).connect("command", 4096)
    command = Command("c1", "s1", "stop").to_bytes()
    answers: list[Ack] = []

    def answered_twice() -> bool:
        with contextlib.suppress(zmq.Again):
            raw.send(command, zmq.NOBLOCK)
        server.serve(body.handle)
        with contextlib.suppress(zmq.Again):
            answers.append(Ack.from_bytes(raw.recv(zmq.NOBLOCK)))
        return len(answers) >= 3

    assert until(answered_twice)
    assert body.kinds() == ["stop"]
    assert answers[0] == answers[1] == answers[2]


def test_garbage_is_counted_and_does_not_stop_the_server(
    operator: Operator, configs: Configs, open_link: Open
) -> None:
    monitor = configs["monitor"]
    raw = open_link(monitor).connect("command", 4096)
    assert operator.robot is not None
    server = operator.robot.server

    def refused() -> bool:
        for parts in ([b"garbage"], [b"", b"two parts"]):
            with contextlib.suppress(zmq.Again):
                raw.send_multipart(parts, zmq.NOBLOCK)
        operator.turn()
        return server.refused >= 2

    assert until(refused)
    assert server.last_refusal
    assert operator.answer(operator.client.send("arm")).accepted


def test_a_stranger_cannot_even_stop_the_robot(
    operator: Operator, configs: Configs, tmp_path: Path
) -> None:
    own = load_keys(configs["monitor"].keys)
    unlisted = load_keys(keygen(tmp_path, ("monitor", "robot"))["monitor"])
    keyless = zmq.Context.instance().socket(zmq.DEALER)
    keyless.linger = 0
    keyless.connect(configs["monitor"].endpoint("command"))
    with Link(replace(unlisted, peers=own.peers), configs["monitor"]) as link:
        stranger = CommandClient(link)
        stranger.send("stop")
        with contextlib.suppress(zmq.Again):  # where it was thrown out before it said anything
            keyless.send(Command("c1", "s1", "stop").to_bytes(), zmq.NOBLOCK)
        deadline_s = time.monotonic() + 0.8
        while time.monotonic() < deadline_s:
            operator.turn()
            assert stranger.poll() == ()
            assert not keyless.poll(0)
            time.sleep(0.01)
    keyless.close()
    assert asked(operator) == []
    assert operator.answer(operator.client.send("arm")).accepted


class Clock:
    """A robot's clock that we set."""

    def __init__(self) -> None:
        self.now_s = 100.0

    def __call__(self) -> float:
        return self.now_s


@pytest.fixture
def timed(configs: Configs, open_link: Open) -> tuple[Operator, Clock]:
    clock = Clock()
    server = CommandServer(open_link(configs["robot"]), clock)
    operator = Operator(CommandClient(open_link(configs["monitor"])), Robot(server))
    assert until(operator.connected)
    return operator, clock


def test_a_command_that_waited_on_the_way_is_refused_but_not_a_stop(
    timed: tuple[Operator, Clock],
) -> None:
    operator, clock = timed
    clock.now_s += MAX_ECHO_AGE_S + 0.1
    late = operator.client.send("arm")
    stop = operator.client.send("stop")
    assert not operator.answer(late).accepted
    assert "send it again" in operator.answers[late].reason
    assert operator.answer(stop).accepted
    assert asked(operator) == ["stop"]
    assert operator.answer(operator.client.send("arm")).accepted


def test_a_restarted_robot_takes_nothing_meant_for_its_predecessor(
    configs: Configs, open_link: Open
) -> None:
    client = CommandClient(open_link(configs["monitor"]))
    with configs["robot"].open() as link:
        operator = Operator(client, Robot(CommandServer(link)))
        assert until(operator.connected)
    successor = Robot(CommandServer(open_link(configs["robot"])))
    operator.robot = None
    time.sleep(0.2)
    sent = [client.send("arm") for _ in range(20) if not time.sleep(0.02)]
    operator.robot = successor
    answers = [operator.answer(command_id) for command_id in sent]
    assert successor.kinds() == []
    assert not any(ack.accepted for ack in answers)
    assert until(operator.connected)  # to the successor, however busy the computer is
    assert operator.answer(client.send("arm")).accepted


def test_the_operator_is_heard_by_beats_and_grows_old_in_silence(
    timed: tuple[Operator, Clock],
) -> None:
    operator, clock = timed
    assert operator.robot is not None
    server = operator.robot.server

    def heard() -> bool:
        operator.turn()
        return server.operator_age_s() < 0.1

    assert until(heard)
    clock.now_s += 5.0
    assert server.operator_age_s() == pytest.approx(5.0, abs=0.01)
    assert until(heard)


def test_beats_held_up_on_the_way_do_not_look_alive(timed: tuple[Operator, Clock]) -> None:
    operator, clock = timed
    assert operator.robot is not None
    server = operator.robot.server
    operator.client.send("beat")
    clock.now_s += 5.0
    time.sleep(0.1)
    server.serve(operator.robot.handle)
    assert server.operator_age_s() >= 5.0


def test_of_two_operators_one_drives_and_both_stop(configs: Configs, open_link: Open) -> None:
    robot, monitor = configs["robot"], configs["monitor"]
    body = Robot(CommandServer(open_link(robot)))
    first, second = (Operator(CommandClient(open_link(monitor)), body) for _ in range(2))
    assert until(first.connected)
    assert until(second.connected)
    assert first.answer(first.client.send("arm")).accepted
    for kind, mission in (("arm", None), ("mission", Mission((1.0, 1.0))), ("manual", None)):
        first.client.poll()
        refused = second.answer(second.client.send(kind, mission))
        assert not refused.accepted
        assert "another operator" in refused.reason
    assert second.answer(second.client.send("stop")).accepted
    assert second.answer(second.client.send("arm")).accepted
    assert not first.answer(first.client.send("arm")).accepted


def test_nobody_heard_is_infinitely_old(configs: Configs, open_link: Open) -> None:
    assert CommandServer(open_link(configs["robot"])).operator_age_s() == float("inf")


def test_without_a_robot_a_command_is_lost_and_says_so_but_a_stop_waits(
    configs: Configs, open_link: Open
) -> None:
    operator = Operator(CommandClient(open_link(configs["monitor"])), None)
    arm, stop = operator.client.send("arm"), operator.client.send("stop")
    assert operator.client.send("stop") == stop, "one STOP is pending at a time"
    assert operator.answer(arm) == Ack(arm, False, "the robot does not answer")
    assert stop not in operator.answers
    robot = Robot(CommandServer(open_link(configs["robot"])))
    operator.robot = robot
    assert operator.answer(stop).accepted
    assert robot.kinds() == ["stop"]
