"""Sizes, ranges, ports and socket options to the figure: each is a promise to another machine."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import Any, Callable, Dict, List

import pytest

from robot.errors import ConfigError, ContractError
from robot.link.command_server import OperatorLock
from robot.link.keys import AllowList, load_keys
from robot.link.messages import (
    Ack,
    Command,
    FrameMessage,
    InputAge,
    Mission,
    MissionStatus,
    PosesMessage,
    Reading,
    Sighting,
    Telemetry,
    thin_path,
)
from robot.link.sockets import Link, LinkConfig, Publisher, Subscriber, new_session
from robot.link.wire import entries, plain, require_size, tidy_text
from tests.robot.link.conftest import free_base_port
from tests.robot.link.fakes import FakeClock, FakeLink

zmq = pytest.importorskip("zmq")

Make = Callable[..., Any]


def sighting(**told: Any) -> Sighting:
    fields = {"robot": "d", "x_m": 0.0, "y_m": 0.0, "heading_rad": 0.0, "confidence": 0.5}
    return Sighting(**{**fields, **told})


def poses(**told: Any) -> PosesMessage:
    return PosesMessage(**{"robots": (sighting(),), "t_capture_s": 1.0, **told})


def frame(**told: Any) -> FrameMessage:
    fields = {"jpeg": b"\xff\xd8\xff\xd9", "t_capture_s": 1.0}
    return FrameMessage(**{**fields, **told})


def report(**told: Any) -> Telemetry:
    return Telemetry(**{"robot": "d", "state": "AUTO", **told})


def command(**told: Any) -> Command:
    return Command(**{"id": "i", "session": "s", "kind": "manual", **told})


def ack(**told: Any) -> Ack:
    return Ack(**{"id": "i", "accepted": True, **told})


def mission(**told: Any) -> MissionStatus:
    return MissionStatus(**{"id": "m", "destination": (0.0, 0.0), **told})


LONG = "n" * 32
PI = math.pi + 1e-6
NAMES = [(LONG, LONG + "n"), ("a.b_c-1", ".a"), ("a", ""), ("Z9", "ä"), ("0", "a b"), ("d", "d\n")]
# maker, field, what may stand there and what may not
RANGES: List[Any] = [
    *((sighting, "x_m", good, bad) for good, bad in ((1000.0, 1000.1), (-1000.0, -1000.1))),
    *((sighting, "y_m", good, bad) for good, bad in ((1000.0, 1000.1), (-1000.0, -1000.1))),
    *((sighting, "heading_rad", good, bad) for good, bad in ((PI, 3.1417), (-PI, -3.1417))),
    *((sighting, "confidence", good, bad) for good, bad in ((0.0, -0.01), (1.0, 1.01))),
    (sighting, "heading_rad", None, math.nan),
    *((sighting, "robot", good, bad) for good, bad in NAMES),
    (poses, "robots", (sighting(),) * 16, (sighting(),) * 17),
    *((poses, "t_capture_s", good, bad) for good, bad in ((0.0, -0.1), (1e10, 1.1e10))),
    *((poses, "session", good, bad) for good, bad in NAMES),
    *((poses, "sequence", good, bad) for good, bad in ((0, -1), (2**53, 2**53 + 1))),
    *((poses, "t_sent_s", good, bad) for good, bad in ((0.0, -0.1), (1e10, 1.1e10))),
    *((frame, "t_capture_s", good, bad) for good, bad in ((0.0, -0.1), (1e10, 1.1e10))),
    *((frame, "sequence", good, bad) for good, bad in ((0, -1), (2**53, 2**53 + 1))),
    *((report, "robot", good, bad) for good, bad in NAMES),
    *((report, "state", good, "SLEEPING") for good in ("DISARMED", "READY", "AUTO", "MANUAL")),
    *((report, "state", good, "auto") for good in ("HOLD", "FAULT")),
    (report, "reason", "r" * 160, "r" * 161),
    (report, "reason", "ä" * 80, "ä" * 80 + "r"),
    (report, "reason", "a b", "a\nb"),
    (report, "model", "m" * 64, "m" * 65),
    (report, "map", "m" * 64, "m" * 65),
    *((report, "action", good, bad) for good, bad in ((0, -1), (4, 5), (None, 9))),
    (report, "values", (1e9,) * 16, (0.0,) * 17),
    *((report, "values", (good,), (bad,)) for good, bad in ((1e9, 1.1e9), (-1e9, -1.1e9))),
    *((report, "pose", (good, 0.0, PI), (bad, 0.0, 0.0)) for good, bad in ((1e3, 1e3 + 1),)),
    (report, "pose", (0.0, 0.0, -PI), (0.0, 0.0, 3.1417)),
    (report, "path", ((0.0, 0.0),) * 96, ((0.0, 0.0),) * 97),
    (report, "path", ((-1e3, 1e3),), ((0.0, 1e3 + 1),)),
    (report, "inputs", (InputAge("a", 0.0, 1.0),) * 8, (InputAge("a", 0.0, 1.0),) * 9),
    (report, "health", (Reading("a", 0.0),) * 8, (Reading("a", 0.0),) * 9),
    *((report, "fps", good, bad) for good, bad in ((0.0, -0.1), (1e4, 1.1e4))),
    (report, "wheels", (100.0, -100.0), (0.0, 100.1)),
    (report, "wheels", None, (-100.1, 0.0)),
    *((report, "lag_s", good, bad) for good, bad in ((0.0, -0.1), (1e6, 1.1e6))),
    *((command, "id", good, bad) for good, bad in NAMES),
    *((command, "session", good, bad) for good, bad in NAMES),
    *((command, "robot_session", good, bad) for good, bad in NAMES),
    *((command, "kind", good, "drive") for good in ("beat", "stop", "disarm", "arm", "clear")),
    *(
        (command, "wheels", good, bad)
        for good, bad in (((1.0, -1.0), (0.1, 1.01)), ((0.0, 0.0), (-1.01, 0.0)))
    ),
    *((command, "robot_time_s", good, bad) for good, bad in ((0.0, -0.1), (1e10, 1.1e10))),
    *((ack, "id", good, bad) for good, bad in NAMES),
    (ack, "reason", "r" * 400, "r" * 401),
    *((ack, "robot_session", good, bad) for good, bad in NAMES),
    *((ack, "robot_time_s", good, bad) for good, bad in ((0.0, -0.1), (1e10, 1.1e10))),
    *((mission, "progress", good, bad) for good, bad in ((0.0, -0.1), (1.0, 1.1))),
    *((mission, "phase", good, "late") for good in ("driving", "arrived", "failed", "stopped")),
]


def number(case: Any) -> str:
    return f"{case.__name__}" if callable(case) else str(case)[:20]


@pytest.mark.parametrize(("make", "field", "good", "bad"), RANGES, ids=number)
def test_a_field_has_its_range(make: Make, field: str, good: Any, bad: Any) -> None:
    assert getattr(make(**{field: good}), field) == good
    with pytest.raises(ContractError):
        make(**{field: bad})


@pytest.mark.parametrize(
    ("make", "good", "bad"),
    [
        (lambda v: InputAge(v, 0.0, 1.0), "n" * 24, "n" * 25),
        (lambda v: InputAge("a", v, 1.0), 1e6, 1.1e6),
        (lambda v: InputAge("a", v, 1.0), 0.0, -0.1),
        (lambda v: InputAge("a", 0.0, v), 1e6, 1.1e6),
        (lambda v: InputAge("a", 0.0, v), 0.0, -0.1),
        (lambda v: Reading(v, 0.0), "n" * 24, "n" * 25),
        (lambda v: Reading("a", v), 1e9, 1.1e9),
        (lambda v: Reading("a", 0.0, v), "u" * 8, "u" * 9),
        (lambda v: Reading("a", 0.0, "", v), "bad", "worse"),
        (lambda v: Mission((v, 0.0)), 1000.0, 1000.1),
        (lambda v: Mission((0.0, v)), -1000.0, -1000.1),
        (lambda v: Mission((0.0, 0.0), (v, 0.0)), 1000.0, 1000.1),
        (lambda v: Mission((0.0, 0.0), (0.0, v)), -1000.0, math.nan),
        (lambda v: require_size("x", v, 4), b"1234", b"12345"),
        (lambda v: entries(4)["entries"]("x", v), "1234", "12345"),
    ],
)
def test_a_part_has_its_range(make: Make, good: Any, bad: Any) -> None:
    make(good)
    with pytest.raises(ContractError):
        make(bad)


@pytest.mark.parametrize("kind", ["plan", "mission"])
def test_a_mission_belongs_to_plan_and_mission(kind: str) -> None:
    assert command(kind=kind, mission=Mission((1.0, 1.0))).mission is not None
    with pytest.raises(ContractError, match="mission"):
        command(kind=kind)
    with pytest.raises(ContractError, match="wheels"):
        command(kind=kind, mission=Mission((1.0, 1.0)), wheels=(0.1, 0.1))


@pytest.mark.parametrize("kind", ["beat", "stop", "disarm", "arm", "clear", "manual"])
def test_and_to_no_other(kind: str) -> None:
    with pytest.raises(ContractError, match="mission"):
        command(kind=kind, mission=Mission((1.0, 1.0)))


def test_a_message_has_four_kilobytes_and_a_frame_sixty_four() -> None:
    data = poses().to_bytes()
    padded = data[:-1] + b" " * (4096 - len(data)) + b"}"
    assert PosesMessage.from_bytes(padded) == poses()
    with pytest.raises(ContractError, match="expected at most 4096 bytes, got 4097"):
        PosesMessage.from_bytes(padded[:-1] + b" }")
    assert [kind.LIMIT_BYTES for kind in (PosesMessage, Telemetry, FrameMessage)] == [
        *(4096, 4096, 65536)
    ]
    with pytest.raises(ContractError, match="expected at most 65536 bytes, got 65537"):
        FrameMessage.from_bytes(frame().to_bytes().ljust(65537))


def test_numbers_go_over_the_wire_with_six_decimals() -> None:
    assert plain({"a": 1}["a"] + 0.12345678) == 1.123457
    assert plain((0.1234564, True, None, 7, "x")) == [0.123456, True, None, 7, "x"]
    assert b'"schema":1' in poses().to_bytes()


def test_text_is_made_to_fit_on_a_line() -> None:
    assert tidy_text("a\n b\t\x00c", 99) == "a b ?c"
    assert tidy_text("äöü", 5) == "äö"


def test_a_thinned_path_has_at_most_96_points_to_the_millimetre() -> None:
    import numpy as np

    line = np.stack((np.linspace(0.0, 10.0, 97), np.zeros(97)), axis=1)
    assert len(thin_path(line)) <= 96
    assert len(thin_path(line[:96])) == 96
    assert thin_path(np.array([[0.12345, -0.0004]])) == ((0.123, -0.0),)


def test_depth_and_doubled_keys_are_refused_by_every_message() -> None:
    for kind in (PosesMessage, Telemetry, Command, Ack):
        for depth in (1, 20, 100, 400, 900, 950, 990, 1000, 1500, 2000):
            for opening, closing in (("[", "]"), ('{"a":', "}")):
                text = opening * depth + "1" + closing * depth
                for body in (text, f'{{"schema":1,"message":"{kind.KIND}","id":{text}}}'):
                    with pytest.raises(ContractError):
                        kind.from_bytes(body.encode()[:5000])


@pytest.mark.parametrize(
    ("stream", "port", "robot"),
    [("pose", 5570, "b"), ("telemetry", 5571, "a"), ("frame", 5572, "a"), ("command", 5573, "a")],
)
def test_each_stream_has_its_port_at_the_machine_that_binds_it(
    stream: str, port: int, robot: str
) -> None:
    config = LinkConfig("k", robot_host="a", localizer_host="b")
    assert config.endpoint(stream) == f"tcp://{robot}:{port}"
    assert config.port(stream) == port


@pytest.mark.parametrize(("good", "bad"), [(1024, 1023), (65531, 65532)])
def test_the_base_port_leaves_room_for_all(good: int, bad: int) -> None:
    assert LinkConfig("k", base_port=good).base_port == good
    with pytest.raises(ConfigError, match="1024 to 65531"):
        LinkConfig("k", base_port=bad)


def options(socket: Any, *names: str) -> Dict[str, Any]:
    return {name: socket.getsockopt(getattr(zmq, name)) for name in names}


CONNECTED = {
    "LINGER": 0,
    "SNDHWM": 2,
    "HEARTBEAT_IVL": 200,
    "HEARTBEAT_TIMEOUT": 600,
    "RECONNECT_IVL": 50,
    "CONNECT_TIMEOUT": 500,
    "HANDSHAKE_IVL": 2000,
}


def test_the_options_of_every_socket(key_folders: Dict[str, Path]) -> None:
    keys = {name: load_keys(folder) for name, folder in key_folders.items()}
    config = LinkConfig("k", base_port=free_base_port())
    with Link(keys["robot"], config) as robot, Link(keys["monitor"], config) as monitor:
        reports = robot.bind("telemetry", 1000)
        ear = robot.bind("command", 1000)
        bound = {**CONNECTED, "HEARTBEAT_IVL": 0, "MAXMSGSIZE": 1064, "RCVHWM": 16}
        for socket, domain in ((reports, b"telemetry"), (ear, b"command")):
            assert options(socket, *bound) == bound
            assert socket.getsockopt(zmq.CURVE_SERVER) == 1
            assert socket.getsockopt(zmq.ZAP_ENFORCE_DOMAIN) == 1
            assert socket.getsockopt(zmq.ZAP_DOMAIN).rstrip(b"\0") == domain
            assert socket.getsockopt(zmq.LAST_ENDPOINT).startswith(b"tcp://0.0.0.0:")
        hears = monitor.connect("telemetry", 1000)
        hand = monitor.connect("command", 1000)
        kinds = [socket.type for socket in (reports, ear, hears, hand)]
        assert kinds == [zmq.PUB, zmq.ROUTER, zmq.SUB, zmq.DEALER]
        connected = {**CONNECTED, "MAXMSGSIZE": 1064}
        for socket in (hears, hand):
            assert options(socket, *connected) == connected
            assert socket.getsockopt(zmq.HEARTBEAT_TTL) == 600
        assert (hears.getsockopt(zmq.IMMEDIATE), hand.getsockopt(zmq.IMMEDIATE)) == (0, 1)


def test_a_turn_admits_sixteen_who_knock(key_folders: Dict[str, Path]) -> None:
    with zmq.Context() as context:
        door = AllowList(context, load_keys(key_folders["robot"]))
        knocks = context.socket(zmq.DEALER)
        knocks.linger = 0
        knocks.connect("inproc://zeromq.zap.01")
        for _ in range(40):
            knocks.send_multipart([b"", b"1.0", b"7", b"command", b"a", b"", b"CURVE", bytes(32)])
        for answered in (16, 32, 40, 40):
            door.admit()
            assert door.reading().value == answered
        knocks.close()
        door.socket.close()


def test_the_helm_is_held_for_a_second_and_remembered_for_two() -> None:
    helm = OperatorLock()
    helm.heard("ann", 10.0)
    helm.done("ann", "arm", 10.0)
    helm.heard("ben", 11.9)
    for now_s, held in ((11.0, True), (11.01, False)):
        assert bool(helm.problem("ben", "arm", now_s)) is held
    assert helm.age_s(12.0) == pytest.approx(2.0), "of her who drives"
    assert helm.age_s(12.01) == pytest.approx(0.11), "of anybody, when she is forgotten"
    for kind in ("clear", "stop", "disarm", "beat", "plan"):
        assert helm.problem("ben", kind, 10.5) == ""
    for kind in ("arm", "mission", "manual"):
        assert helm.problem("ben", kind, 10.5)
        assert helm.problem("ann", kind, 10.5) == ""


@pytest.mark.parametrize(("kind", "frees"), [("stop", True), ("disarm", True), ("clear", False)])
def test_stop_and_disarm_free_the_helm(kind: str, frees: bool) -> None:
    helm = OperatorLock()
    helm.heard("ann", 10.0)
    helm.done("ann", "arm", 10.0)
    helm.done("ben", kind, 10.1)
    assert (helm.problem("ben", "arm", 10.2) == "") is frees


def test_a_publisher_stamps_session_sequence_and_time() -> None:
    link, clock = FakeLink(), FakeClock(7.0)
    publisher = Publisher(link, PosesMessage, clock)  # type: ignore[arg-type]
    assert link.opened == {("bind", "pose", 4096)}
    for number in (1, 2, 3):
        sent = publisher.send(poses())
        assert (sent.session, sent.sequence, sent.t_sent_s) == (publisher.session, number, 7.0)
        assert PosesMessage.from_bytes(link.socket.sent[-1]) == sent
        assert link.admitted == number
    assert len(new_session()) == 16
    assert new_session() != new_session()


def test_a_subscriber_keeps_the_newest_and_connects_anew_after_two_seconds() -> None:
    link, clock = FakeLink(), FakeClock(7.0)
    listener = Subscriber(link, FrameMessage, clock)  # type: ignore[arg-type]
    assert link.opened == {("connect", "frame", 65536)}
    for clock.now_s, times in ((9.0, 0), (9.01, 1), (11.0, 1), (11.02, 2)):
        assert listener.receive() is None
        assert len(link.reconnected) == times, clock.now_s
    link.socket.waiting.append([frame().to_bytes()])
    clock.now_s = 12.5
    assert listener.receive() == frame()
    link.socket.waiting.append([b"garbage"])
    clock.now_s = 13.0
    assert listener.receive() is None
    assert (listener.refused, bool(listener.last_refusal)) == (1, True)
    clock.now_s = 15.0
    listener.receive()
    assert len(link.reconnected) == 2, "garbage shows that somebody is there"
    assert replace(frame(), sequence=4).sequence == 4
