"""Who may do what: only a monitor commands, only the localizer tells poses, whatever they claim."""

from __future__ import annotations

import contextlib
import logging
import time
from dataclasses import replace
from typing import Callable, Dict, List, Optional

import pytest

from robot.errors import ConfigError
from robot.link.command_client import CommandClient
from robot.link.command_server import CommandServer
from robot.link.keys import ADMITS, BOUND_BY, Keys, Peer, load_keys
from robot.link.messages import Command, FrameMessage, Mission, PosesMessage, Sighting, Telemetry
from robot.link.sockets import Link, LinkConfig, Publisher, Subscriber
from tests.robot.link.conftest import until

zmq = pytest.importorskip("zmq")

Open = Callable[[LinkConfig], Link]
Configs = Dict[str, LinkConfig]
POSES = PosesMessage((Sighting("duck", 1.0, 2.0, 0.5, 0.9),), t_capture_s=0.0)
FRAME = FrameMessage(b"\xff\xd8\xff\xd9", 0.0)
REPORT = Telemetry("duck", "DISARMED")


def test_the_table_of_roles() -> None:
    assert BOUND_BY == {
        "pose": "localizer",
        "telemetry": "robot",
        "frame": "robot",
        "command": "robot",
    }
    assert ADMITS == {
        "pose": ("robot", "monitor"),
        "telemetry": ("robot", "monitor"),
        "frame": ("monitor",),
        "command": ("monitor",),
    }


@pytest.mark.parametrize("role", ["robot", "localizer", "monitor"])
def test_each_program_opens_what_is_its_own_and_nothing_else(
    configs: Configs, open_link: Open, role: str
) -> None:
    config = configs[role]
    link = open_link(config)
    opened: Dict[str, Callable[[], object]] = {
        "tells poses": lambda: Publisher(link, PosesMessage),
        "hears poses": lambda: Subscriber(link, PosesMessage),
        "reports": lambda: Publisher(link, Telemetry),
        "shows": lambda: Publisher(link, FrameMessage),
        "hears reports": lambda: Subscriber(link, Telemetry),
        "sees": lambda: Subscriber(link, FrameMessage),
        "obeys": lambda: CommandServer(link),
        "commands": lambda: CommandClient(link),
    }
    may = {
        "robot": {"hears poses", "reports", "shows", "obeys"},
        "localizer": {"tells poses"},
        "monitor": {"hears poses", "hears reports", "sees", "commands"},
    }
    for what, work in opened.items():
        if what in may[role]:
            work()
        else:
            of_others = role == "robot" and what == "hears reports"  # of which it has no key
            told = "expected one robot, got none" if of_others else f"got those of the {role}; name"
            with pytest.raises(ConfigError, match=told):
                work()


def posing(
    config: LinkConfig, as_role: str, thief: LinkConfig, peers: Optional[Dict[str, Peer]] = None
) -> Link:
    """A link with the thief's keys, which says that it is something else."""
    keys = load_keys(thief.keys)
    told = replace(keys, role=as_role, peers=keys.peers if peers is None else peers)
    return Link(told, config)


class Ear:
    """A robot that notes what it is asked."""

    def __init__(self, config: LinkConfig, link: Link) -> None:
        self.server = CommandServer(link)
        self.asked: List[Command] = []

    def serve(self) -> None:
        self.server.serve(self.asked.append)


COMMANDS = (
    Command("c1", "s", "stop"),
    Command("c2", "s", "arm"),
    Command("c3", "s", "mission", Mission((1.0, 1.0))),
    Command("c4", "s", "disarm"),
    Command("c5", "s", "beat"),
)


@pytest.mark.parametrize("thief", ["localizer", "robot"])
def test_only_a_monitor_commands(
    configs: Configs, open_link: Open, caplog: pytest.LogCaptureFixture, thief: str
) -> None:
    """Whoever has another machine's secret may say that it is a monitor: nobody listens."""
    link = open_link(configs["robot"])
    ear = Ear(configs["robot"], link)
    peers = {"robot": Peer("robot", load_keys(configs["robot"].keys).public)}
    thieving = posing(configs["monitor"], "monitor", configs[thief], peers)
    socket = thieving.connect("command", 4096)
    deadline_s = time.monotonic() + 1.0
    with caplog.at_level(logging.WARNING):
        while time.monotonic() < deadline_s:
            for command in COMMANDS:
                with contextlib.suppress(zmq.Again):
                    socket.send(command.to_bytes(), zmq.NOBLOCK)
            ear.serve()
            time.sleep(0.01)
    assert ear.asked == []
    assert ear.server.operator_age_s() == float("inf")
    assert f"the key of {thief} at 127.0.0.1 was turned away from 'command'" in caplog.text
    assert "expected a key of monitor" in caplog.text
    reading = link.allow_list.reading()
    assert reading.name == f"turned away: {thief}"
    assert reading.value >= 1
    assert reading.level == "warn"

    monitor = configs["monitor"]
    client = CommandClient(open_link(monitor))

    def heard() -> bool:
        ear.serve()
        client.poll()
        return ear.server.operator_age_s() < 1.0

    assert until(heard), "the monitor is let in beside them"


def test_the_server_looks_at_each_message_even_behind_an_open_door(
    configs: Configs, open_link: Open, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Two locks: were the door left open, the localizer still would not be obeyed."""
    from robot.link import keys

    link = open_link(configs["robot"])
    ear = Ear(configs["robot"], link)
    monkeypatch.setattr(keys.AllowList, "_verdict", _let_in)
    thieving = posing(configs["monitor"], "monitor", configs["localizer"])
    socket = thieving.connect("command", 4096)

    def refused() -> bool:
        with contextlib.suppress(zmq.Again):
            socket.send(COMMANDS[0].to_bytes(), zmq.NOBLOCK)
        ear.serve()
        return ear.server.refused > 0

    assert until(refused)
    assert ear.asked == []
    assert ear.server.last_refusal == (
        "command: expected a monitor's key, got the key of localizer"
    )


def _let_in(self: object, request: List[bytes]) -> List[bytes]:
    return [b"1.0", request[1], b"200", b"OK", b"localizer", b""]


LISTENERS = [
    ("telemetry", Telemetry, REPORT, "localizer"),
    ("frame", FrameMessage, FRAME, "localizer"),
]


@pytest.mark.parametrize(("stream", "kind", "message", "thief"), LISTENERS)
def test_what_the_robot_tells_is_for_monitors(
    configs: Configs, open_link: Open, stream: str, kind: type, message: object, thief: str
) -> None:
    robot, monitor = configs["robot"], configs["monitor"]
    publisher: Publisher = Publisher(open_link(robot), kind)
    spy = Subscriber(posing(monitor, "monitor", configs[thief]), kind)
    own = Subscriber(open_link(monitor), kind)
    heard: List[object] = []

    def own_heard() -> bool:
        publisher.send(message)
        assert spy.receive() is None
        heard.append(own.receive())
        return sum(one is not None for one in heard) >= 20

    assert until(own_heard)


@pytest.mark.parametrize(
    ("stream", "kind", "message", "thief", "listener"),
    [
        ("pose", PosesMessage, POSES, "monitor", "robot"),
        ("pose", PosesMessage, POSES, "robot", "monitor"),
        ("telemetry", Telemetry, REPORT, "localizer", "monitor"),
        ("frame", FrameMessage, FRAME, "localizer", "monitor"),
    ],
)
def test_nobody_speaks_for_another(
    configs: Configs, stream: str, kind: type, message: object, thief: str, listener: str
) -> None:
    """The publisher's place is taken by another machine, with its own true keys."""
    config = configs[listener]
    with posing(config, BOUND_BY[stream], configs[thief]) as stolen, config.open() as link:
        publisher: Publisher = Publisher(stolen, kind)
        subscriber = Subscriber(link, kind)
        deadline_s = time.monotonic() + 0.8
        while time.monotonic() < deadline_s:
            publisher.send(message)
            assert subscriber.receive() is None
            time.sleep(0.01)
        assert subscriber.refused == 0


def test_a_second_monitor_is_let_in_by_its_role_whatever_its_name(
    configs: Configs, open_link: Open
) -> None:
    import zmq as library

    public, secret = library.curve_keypair()
    own = load_keys(configs["robot"].keys)
    lamp, _ = library.curve_keypair()
    tablet = {"tablet": Peer("monitor", public), "lamp": Peer("localizer", lamp)}
    link = Link(replace(own, peers=tablet), configs["robot"])
    server = CommandServer(link)
    keys = Keys("monitor", public, secret, {"robot": Peer("robot", own.public)})
    mine = Link(keys, configs["monitor"])
    client = CommandClient(mine)

    def heard() -> bool:
        server.serve(lambda _: None)
        client.poll()
        return server.operator_age_s() < 1.0

    assert until(heard)
    assert link.allow_list.may("tablet", "command")
    assert not link.allow_list.may("lamp", "command")
    assert not link.allow_list.may("nobody", "command")
    link.close()
    mine.close()


def test_who_knocks_again_and_again_is_told_of_once_in_ten_seconds(
    key_folders: Dict[str, object], caplog: pytest.LogCaptureFixture
) -> None:
    from robot.link.keys import AllowList

    now_s = [100.0]
    with zmq.Context() as context:
        door = AllowList(context, load_keys(str(key_folders["robot"])), lambda: now_s[0])
        request = [b"1.0", b"7", b"command", b"10.0.0.9", b"", b"CURVE", bytes(32)]
        for _ in range(100):
            assert door._verdict(request)[2] == b"400"
            now_s[0] += 0.0999
        assert caplog.text.count("a stranger at 10.0.0.9") == 1
        now_s[0] += 0.1
        door._verdict(request)
        assert caplog.text.count("a stranger at 10.0.0.9") == 2
        assert door.reading().value == 101
        door.socket.close()


@pytest.mark.parametrize(
    "spoilt",
    [
        [],
        [b"1.0"],
        [b"1.0", b"7", b"command", b"a", b"", b"CURVE"],
        [b"1.0", b"7", b"command", b"a", b"", b"CURVE", b"short"],
        [b"1.0", b"7", b"\xff\x00", b"\xfe", b"", b"CURVE", bytes(32)],
        [b"1.0", b"7", b"command", b"a", b"", b"PLAIN", b"user", b"password"],
        [b"1.0", b"7", b"command", b"a", b"", b"NULL"],
    ],
)
def test_whatever_is_asked_at_the_door_is_answered(
    key_folders: Dict[str, object], spoilt: List[bytes]
) -> None:
    from robot.link.keys import AllowList

    with zmq.Context() as context:
        door = AllowList(context, load_keys(str(key_folders["robot"])))
        assert door._verdict(spoilt)[2] == b"400"
        door.socket.close()


def test_a_key_counts_with_curve_and_for_a_stream_that_there_is(
    key_folders: Dict[str, object],
) -> None:
    from zmq.utils import z85

    from robot.link.keys import AllowList

    key = z85.decode(load_keys(str(key_folders["monitor"])).public)
    with zmq.Context() as context:
        door = AllowList(context, load_keys(str(key_folders["robot"])))
        for stream, mechanism, code in (
            (b"command", b"CURVE", b"200"),
            (b"command", b"GSSAPI", b"400"),
            (b"", b"CURVE", b"400"),
            (b"steering", b"CURVE", b"400"),
        ):
            verdict = door._verdict([b"1.0", b"7", stream, b"a", b"", mechanism, key])
            assert verdict[1:3] == [b"7", code], (stream, mechanism)
        door.socket.close()


def test_a_long_name_that_is_turned_away_can_be_told(key_folders: Dict[str, object]) -> None:
    from zmq.utils import z85

    from robot.link.keys import AllowList

    own = load_keys(str(key_folders["robot"]))
    lamp, _ = zmq.curve_keypair()
    with zmq.Context() as context:
        door = AllowList(context, replace(own, peers={"lamp-" * 9: Peer("localizer", lamp)}))
        door._verdict([b"1.0", b"7", b"command", b"a", b"", b"CURVE", z85.decode(lamp)])
        assert door.reading().name == "turned away: lamp-lamp-l"
        door.socket.close()
