"""The rules of commands to the figure, without a network: ages, counts, repeats, who is heard."""

from __future__ import annotations

from typing import Any, List, Optional

import pytest

from robot.errors import ContractError, HardwareError, PlanError
from robot.link.command_client import CommandClient
from robot.link.command_server import CommandServer
from robot.link.messages import Ack, Command, Mission
from tests.robot.link.fakes import FakeClock, FakeLink, FakePart

zmq = pytest.importorskip("zmq")

MOVES = ("arm", "auto", "clear", "plan", "mission", "place", "manual")

TO = Mission((1.0, 2.0), (0.0, 0.0))


class Ear:
    """The robot's side at 100 s of its clock."""

    def __init__(self) -> None:
        self.link, self.clock = FakeLink(("monitor", "tablet")), FakeClock()
        self.server = CommandServer(self.link, self.clock)  # type: ignore[arg-type]
        self.asked: List[Command] = []
        self.refuses: Optional[str] = None
        self._number = 0

    def handle(self, command: Command) -> None:
        if self.refuses is not None:
            raise PlanError(self.refuses)
        self.asked.append(command)

    def command(self, kind: str, echo_s: float = 100.0, **fields: Any) -> Command:
        self._number += 1
        told = {
            "id": f"c{self._number}",
            "session": "s1",
            "mission": TO if kind in ("plan", "mission", "place") else None,
            "robot_session": self.server.session,
            "robot_time_s": echo_s,
            **fields,
        }
        return Command(kind=kind, **told)

    def hears(self, data: bytes, user: str = "monitor", more: int = 0) -> None:
        parts = [FakePart(b"peer", user)] + [FakePart(b"", user)] * more
        self.link.socket.waiting.append([*parts, FakePart(data, user)])

    def answer(self, command: Command, user: str = "monitor") -> Ack:
        self.hears(command.to_bytes(), user)
        self.server.serve(self.handle)
        return Ack.from_bytes(self.link.socket.sent[-1])

    def take(self, kind: str, echo_s: float = 100.0, user: str = "monitor", **fields: Any) -> Ack:
        return self.answer(self.command(kind, echo_s, **fields), user)


def test_the_ear_is_a_router_for_four_kilobytes() -> None:
    ear = Ear()
    assert ear.link.opened == {("bind", "command", 4096)}


@pytest.mark.parametrize("kind", MOVES)
@pytest.mark.parametrize(
    ("age_s", "taken"),
    [
        *((0.0, True), (0.69, True), (0.6999, True), (0.7001, False), (5.0, False)),
        *((-0.0009, True), (-0.0011, False), (-1.0, False)),
    ],
)
def test_a_command_that_moves_is_at_most_seven_tenths_of_a_second_old(
    kind: str, age_s: float, taken: bool
) -> None:
    ear = Ear()
    ear.clock.now_s = 100.0
    ack = ear.take(kind, echo_s=100.0 - age_s)
    assert ack.accepted is taken
    assert (len(ear.asked) == 1) is taken
    if not taken:
        assert ack.reason == f"the command is {age_s:.1f} s old; send it again"


@pytest.mark.parametrize("kind", ["stop", "disarm"])
@pytest.mark.parametrize("age_s", [0.0, 99.0, -50.0])
@pytest.mark.parametrize("session", [None, "unsent", "another"])
def test_stop_and_disarm_are_taken_however_old(
    kind: str, age_s: float, session: Optional[str]
) -> None:
    ear = Ear()
    told = {} if session is None else {"robot_session": session}
    ack = ear.take(kind, 100.0 - age_s, **told)
    assert (ack.accepted, ack.robot_session, ack.robot_time_s) == (True, ear.server.session, 100.0)
    assert [command.kind for command in ear.asked] == [kind]


@pytest.mark.parametrize("kind", MOVES)
def test_a_command_for_the_robot_before_its_restart_is_refused(kind: str) -> None:
    ear = Ear()
    ack = ear.take(kind, robot_session="another")
    assert not ack.accepted
    assert ack.reason.startswith("the robot was started since")
    assert ear.asked == []


def test_a_beat_is_answered_with_the_robots_clock_and_asks_for_nothing() -> None:
    ear = Ear()
    ack = ear.take("beat")
    assert (ack.accepted, ack.reason) == (True, "")
    assert (ack.robot_session, ack.robot_time_s) == (ear.server.session, 100.0)
    assert ear.asked == []


def test_the_operators_age_counts_from_the_echo_and_never_from_the_future() -> None:
    ear = Ear()
    assert ear.server.operator_age_s() == float("inf")
    ear.take("beat", 99.6)
    assert ear.server.operator_age_s() == pytest.approx(0.4)
    ear.take("beat", 99.2)
    assert ear.server.operator_age_s() == pytest.approx(0.4), "an older one does not make it older"
    ear.take("beat", 5000.0)
    assert ear.server.operator_age_s() == 0.0
    ear.clock.now_s = 103.0
    assert ear.server.operator_age_s() == pytest.approx(3.0), "nor does the future keep it young"


@pytest.mark.parametrize("kind", ["arm", "auto", "mission", "manual"])
def test_who_gets_the_helm_is_as_old_as_its_echo(kind: str) -> None:
    ear = Ear()
    assert ear.take(kind, 99.5).accepted
    assert ear.server.operator_age_s() == pytest.approx(0.5)
    ear.clock.now_s = 100.4
    assert ear.server.operator_age_s() == pytest.approx(0.9)
    ear.take("beat", 99.9)
    ear.take("beat", 99.2)
    assert ear.server.operator_age_s() == pytest.approx(0.5), "an older one makes it no older"


def test_a_beat_for_another_session_keeps_nobody_alive() -> None:
    ear = Ear()
    ear.take("beat", robot_session="another")
    assert ear.server.operator_age_s() == float("inf")


@pytest.mark.parametrize("user", ["localizer", "robot", "stranger", ""])
@pytest.mark.parametrize("kind", ["beat", "stop", "disarm", *MOVES])
def test_only_monitors_are_heard_message_by_message(user: str, kind: str) -> None:
    ear = Ear()
    ear.hears(ear.command(kind).to_bytes(), user)
    ear.server.serve(ear.handle)
    assert ear.asked == []
    assert ear.link.socket.sent == []
    assert ear.server.refused == 1
    assert ear.server.last_refusal == f"command: expected a monitor's key, got the key of {user}"
    assert ear.server.operator_age_s() == float("inf")


def test_one_id_is_done_once_for_each_sender() -> None:
    ear = Ear()
    first = ear.answer(ear.command("stop", id="x"))
    ear.clock.now_s = 109.0
    assert ear.answer(ear.command("stop", id="x")) == first
    assert len(ear.asked) == 1
    ear.answer(ear.command("stop", id="x", session="s2"))
    ear.answer(ear.command("stop", id="x"), user="tablet")
    assert len(ear.asked) == 3, "another's command with the same name is another command"


def test_the_answers_of_256_commands_are_remembered() -> None:
    ear = Ear()
    for number in range(257):
        ear.answer(ear.command("stop", id=f"n{number}"))
    assert len(ear.asked) == 257
    ear.answer(ear.command("stop", id="n1"))
    assert len(ear.asked) == 257, "of the last 256"
    ear.answer(ear.command("stop", id="n0"))
    assert len(ear.asked) == 258, "and no more: memory is bounded"


def test_beats_push_no_answer_out() -> None:
    ear = Ear()
    ear.answer(ear.command("stop", id="x"))
    for _ in range(300):
        ear.take("beat")
    ear.answer(ear.command("stop", id="x"))
    assert len(ear.asked) == 1


def test_a_turn_serves_32_and_lets_the_loop_go_on() -> None:
    ear = Ear()
    for _ in range(70):
        ear.hears(ear.command("stop").to_bytes())
    for served in (32, 64, 70, 70):
        ear.server.serve(ear.handle)
        assert len(ear.asked) == served
    assert ear.link.admitted == 4, "and opens the door each time"


@pytest.mark.parametrize("more", [1, 2])
def test_a_command_is_one_part(more: int) -> None:
    ear = Ear()
    ear.hears(ear.command("stop").to_bytes(), more=more)
    ear.server.serve(ear.handle)
    assert ear.asked == []
    assert ear.server.refused == 1
    assert ear.server.last_refusal == f"command: expected one part, got {1 + more}"


def test_a_refusal_is_told_in_four_hundred_bytes_and_never_without_words() -> None:
    ear = Ear()
    ear.refuses = "no " * 400
    ack = ear.take("arm")
    assert not ack.accepted
    assert len(ack.reason.encode()) == 400
    ear.refuses = ""
    assert ear.take("arm").reason == "refused"


@pytest.mark.parametrize("error", [HardwareError("the HAT is gone"), KeyError("bug")])
def test_a_part_that_fails_is_no_refusal_and_gives_nobody_the_helm(error: Exception) -> None:
    """Whoever serves hears of it: the robot is in doubt, and stops."""
    ear = Ear()

    def failing(_: Command) -> None:
        raise error

    ear.hears(ear.command("arm").to_bytes())
    with pytest.raises(type(error)):
        ear.server.serve(failing)
    assert ear.link.socket.sent == []
    assert ear.take("arm", user="tablet").accepted


def test_who_armed_has_the_helm_for_a_second() -> None:
    ear = Ear()
    assert ear.take("arm").accepted
    for kind in ("arm", "auto", "mission", "manual"):
        assert "another operator" in ear.take(kind, user="tablet").reason
    for kind in ("plan", "clear", "stop"):
        assert ear.take(kind, user="tablet").accepted
    assert ear.take("arm", user="tablet").accepted, "free after a stop"
    ear.clock.now_s = 101.0
    assert not ear.take("arm", 101.0).accepted
    ear.clock.now_s = 101.01
    assert ear.take("arm", 101.01).accepted, "nobody was heard for a second"


def test_a_move_that_the_robot_refuses_gives_nobody_the_helm() -> None:
    ear = Ear()
    ear.refuses = "no picture"
    ear.take("arm")
    ear.refuses = None
    assert ear.take("arm", user="tablet").accepted


class Hand:
    """The operator's side at 10 s of its clock, connected to a robot that we play."""

    def __init__(self) -> None:
        self.link, self.clock = FakeLink(), FakeClock(10.0)
        self.client = CommandClient(self.link, self.clock)  # type: ignore[arg-type]

    @property
    def sent(self) -> List[Command]:
        return [Command.from_bytes(data) for data in self.link.socket.sent]

    def kinds(self) -> List[str]:
        return [command.kind for command in self.sent]

    def at(self, now_s: float, beat: bool = False) -> tuple:
        self.clock.now_s = now_s
        return self.client.poll(beat)

    def robot_says(self, ack: Ack) -> None:
        self.link.socket.waiting.append([ack.to_bytes()])


def test_the_hand_is_a_dealer_for_four_kilobytes() -> None:
    hand = Hand()
    assert hand.link.opened == {("connect", "command", 4096)}


def test_it_beats_ten_times_a_second_and_only_when_asked() -> None:
    hand = Hand()
    for beat in range(11):
        hand.at(10.0 + 0.1001 * beat, beat=True)
        hand.at(10.099 + 0.1001 * beat, beat=True)
        assert hand.kinds() == ["beat"] * (beat + 1)
    hand.at(20.0, beat=False)
    assert len(hand.sent) == 11


def test_nobody_is_told_what_became_of_a_beat() -> None:
    hand = Hand()
    assert hand.at(10.0, beat=True) == ()
    hand.robot_says(Ack(hand.sent[0].id, True, "", "robot1", 55.5))
    assert hand.at(10.05) == ()
    assert hand.client.silence_s() == 0.0
    hand.at(10.2, beat=True)
    assert hand.at(11.3) == (), "nor that it was not answered"


def test_a_stop_is_repeated_every_tenth_of_a_second_until_it_is_answered() -> None:
    hand = Hand()
    stop = hand.client.send("stop")
    for now_s, times in ((10.09, 1), (10.101, 2), (10.19, 2), (10.202, 3), (13.0, 4)):
        assert hand.at(now_s) == ()
        assert hand.kinds() == ["stop"] * times, now_s
    assert {command.id for command in hand.sent} == {stop}
    hand.robot_says(Ack(stop, True))
    assert [ack.id for ack in hand.at(13.05)] == [stop]
    assert hand.at(14.0) == ()
    assert hand.kinds() == ["stop"] * 4
    assert hand.client.send("stop") != stop


def test_who_presses_stop_again_and_again_repeats_the_one_that_is_not_answered() -> None:
    hand = Hand()
    first = hand.client.send("stop")
    assert [hand.client.send("stop") for _ in range(9)] == [first] * 9
    hand.at(10.101)
    assert [command.id for command in hand.sent] == [first] * 2
    assert hand.client.send("arm") != hand.client.send("arm"), "anything else is told anew"


@pytest.mark.parametrize("kind", ["arm", "disarm", "clear", "manual"])
def test_anything_else_is_sent_once_and_has_a_second(kind: str) -> None:
    hand = Hand()
    sent = hand.client.send(kind)
    assert hand.at(10.99) == ()
    assert hand.at(11.0) == (Ack(sent, False, "the robot does not answer"),)
    assert hand.at(12.0) == ()
    assert hand.kinds() == [kind]
    hand.robot_says(Ack(sent, True))
    assert hand.at(12.1) == (), "an answer after that is no answer"


def test_every_command_echoes_what_the_robot_said_last() -> None:
    hand = Hand()
    hand.client.send("arm")
    assert (hand.sent[0].robot_session, hand.sent[0].robot_time_s) == ("unsent", 0.0)
    hand.robot_says(Ack("any", True, "", "robot1", 55.5))
    hand.at(10.1)
    hand.client.send("arm")
    assert (hand.sent[1].robot_session, hand.sent[1].robot_time_s) == ("robot1", 55.5)
    assert hand.sent[0].id != hand.sent[1].id
    assert hand.sent[0].session == hand.sent[1].session == hand.client.session


def test_all_answers_that_wait_are_taken_at_once_and_the_last_is_echoed() -> None:
    hand = Hand()
    sent = [hand.client.send("arm"), hand.client.send("clear")]
    hand.robot_says(Ack(sent[0], True, "", "robot1", 55.5))
    hand.link.socket.waiting.append([b"garbage"])
    hand.robot_says(Ack(sent[1], False, "no", "robot2", 3.0))
    assert [ack.id for ack in hand.at(10.1)] == sent
    hand.client.send("arm")
    last = hand.sent[-1]
    assert (last.robot_session, last.robot_time_s) == ("robot2", 3.0), "its clock began anew"


def test_silence_is_since_the_last_answer_and_garbage_is_none() -> None:
    hand = Hand()
    assert hand.client.silence_s() == float("inf")
    hand.robot_says(Ack("any", True))
    hand.at(10.5)
    hand.link.socket.waiting.append([b"garbage"])
    hand.at(11.0)
    assert not hand.link.socket.waiting
    assert hand.client.silence_s() == pytest.approx(0.5)


def test_it_connects_anew_after_two_seconds_of_silence_and_every_two_after() -> None:
    hand = Hand()
    for now_s, times in ((12.0, 0), (12.01, 1), (13.9, 1), (14.02, 2)):
        hand.at(now_s)
        assert len(hand.link.reconnected) == times, now_s
    hand.robot_says(Ack("any", True))
    hand.at(14.5)
    for now_s, times in ((16.5, 2), (16.51, 3)):
        hand.at(now_s)
        assert len(hand.link.reconnected) == times, now_s
    assert set(hand.link.reconnected) == {"command"}


def test_without_a_connection_nothing_breaks_and_a_stop_goes_on_trying() -> None:
    hand = Hand()
    hand.link.socket.connected = False
    hand.client.send("stop")
    hand.at(10.2)
    hand.link.socket.connected = True
    hand.at(10.4)
    assert hand.kinds() == ["stop"]


def test_who_says_where_it_stands_says_both_ends_of_the_drag() -> None:
    with pytest.raises(ContractError, match="expected the start of a mission"):
        Ear().command("place", mission=Mission((1.0, 2.0)))
