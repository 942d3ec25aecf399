"""Streams over real loopback sockets: who receives, what is refused, what silence looks like."""

from __future__ import annotations

import shutil
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path
from typing import Callable, Dict

import pytest

from robot.errors import ConfigError
from robot.link.freshness import PoseGate
from robot.link.keys import keygen, load_keys
from robot.link.messages import PosesMessage, Sighting, Telemetry
from robot.link.sockets import Link, LinkConfig, OtherRobot, Publisher, Subscriber
from tests.robot.link.conftest import free_base_port, until

zmq = pytest.importorskip("zmq")

Open = Callable[[LinkConfig], Link]
Configs = Dict[str, LinkConfig]
POSE = PosesMessage((Sighting("duck", 1.0, 2.0, 0.5, 0.9),), t_capture_s=time.monotonic())


def pair(configs: Configs, open_link: Open, to: str = "robot") -> tuple[Publisher, Subscriber]:
    localizer, receiver = configs["localizer"], configs[to]
    publisher = Publisher(open_link(localizer), PosesMessage)
    return publisher, Subscriber(open_link(receiver), PosesMessage)


def deliver(publisher: Publisher, subscriber: Subscriber, timeout_s: float = 3.0) -> PosesMessage:
    """Publish until the subscriber has one."""
    got = []

    def arrived() -> bool:
        publisher.send(replace(POSE, t_capture_s=time.monotonic()))
        message = subscriber.receive()
        if message is not None:
            got.append(message)
        return bool(got)

    assert until(arrived, timeout_s), "nothing arrived"
    return got[-1]


@pytest.mark.parametrize("to", ["robot", "monitor"])
def test_allowed_keys_receive(configs: Configs, open_link: Open, to: str) -> None:
    publisher, subscriber = pair(configs, open_link, to)
    message = deliver(publisher, subscriber)
    assert message.session == publisher.session
    pose = message.of("duck")
    assert pose is not None
    assert (pose.x_m, pose.y_m) == (1.0, 2.0)


def test_a_robot_hears_the_one_of_others_whose_key_it_has(
    configs: Configs, open_link: Open, tmp_path: Path
) -> None:
    others = keygen(tmp_path, ("robot", "monitor"))
    own, its = Path(configs["robot"].keys), others["robot"]
    name = "rover"
    shutil.copytree(own, tmp_path / "own")
    shutil.copy(its / "public.key", tmp_path / "own" / "allowed" / f"{name}.key")
    third = keygen(tmp_path / "third", ("robot", "monitor"))["robot"]
    shutil.copy(third / "public.key", tmp_path / "own" / "allowed" / "third.key")
    shutil.copy(own / "public.key", its / "allowed" / "robot.key")
    other = OtherRobot(name, "127.0.0.1", free_base_port())
    publisher = Publisher(open_link(LinkConfig(str(its), base_port=other.base_port)), Telemetry)
    link = open_link(replace(configs["robot"], keys=str(tmp_path / "own"), robots=(other,)))
    subscriber = Subscriber(link.to(other), Telemetry)
    got = []

    def arrived() -> bool:
        publisher.send(Telemetry(name, "AUTO"))
        got.append(subscriber.receive())
        return got[-1] is not None

    assert until(arrived)
    assert got[-1].robot == name
    far = link.to(replace(other, host="10.0.0.7"))
    assert far.config.endpoint("telemetry") == f"tcp://10.0.0.7:{other.base_port + 1}"
    for nobody in ("scout", "localizer"):
        with pytest.raises(ConfigError, match=rf"a robot's in allowed/{nobody}\.key, got none"):
            link.to(replace(other, name=nobody))


def strangers(configs: Configs, tmp_path: Path) -> dict[str, Link]:
    """Links that must receive nothing: unlisted key, wrong server key."""
    own = load_keys(configs["robot"].keys)
    unlisted = load_keys(keygen(tmp_path, ("robot", "localizer"))["robot"])
    return {
        "unlisted": Link(replace(unlisted, peers=own.peers), configs["robot"]),
        "wrong server": Link(replace(own, peers=unlisted.peers), configs["robot"]),
    }


def test_strangers_receive_nothing(configs: Configs, open_link: Open, tmp_path: Path) -> None:
    publisher, subscriber = pair(configs, open_link)
    links = strangers(configs, tmp_path)
    others = {n: Subscriber(k, PosesMessage) for n, k in links.items()}
    keyless = zmq.Context.instance().socket(zmq.SUB)
    keyless.subscribe(b"")
    keyless.connect(configs["robot"].endpoint("pose"))
    deliver(publisher, subscriber)
    leaked = []
    deadline_s = time.monotonic() + 1.0
    while time.monotonic() < deadline_s:
        publisher.send(POSE)
        leaked += [name for name, other in others.items() if other.receive() is not None]
        leaked += ["keyless"] * bool(keyless.poll(0))
        time.sleep(0.01)
    for link in links.values():
        link.close()
    keyless.close(0)
    assert leaked == []
    assert deliver(publisher, subscriber), "strangers must not disturb those who are allowed"


def test_only_the_newest_after_a_pause(configs: Configs, open_link: Open) -> None:
    publisher, subscriber = pair(configs, open_link)
    deliver(publisher, subscriber)
    for _ in range(60):
        last = publisher.send(POSE)
        time.sleep(0.005)
    time.sleep(0.1)
    received = subscriber.receive()
    assert received is not None
    assert received.sequence == last.sequence
    assert subscriber.receive() is None


def test_a_publisher_that_dies_is_only_silent_and_its_successor_is_heard_within_a_second(
    configs: Configs, open_link: Open
) -> None:
    localizer, robot = configs["localizer"], configs["robot"]
    subscriber = Subscriber(open_link(robot), PosesMessage)
    gate = PoseGate("duck")
    with localizer.open() as link:
        message = deliver(Publisher(link, PosesMessage), subscriber)
        assert gate.take(message.of("duck"), time.monotonic())
    time.sleep(0.1)
    subscriber.receive()
    time.sleep(0.5)
    assert subscriber.receive() is None
    assert gate.stream.age_s(time.monotonic()) > 0.5
    publisher = Publisher(open_link(localizer), PosesMessage)
    began_s = time.monotonic()
    message = deliver(publisher, subscriber)
    assert time.monotonic() - began_s < 1.0
    assert gate.take(message.of("duck"), time.monotonic())
    assert gate.stream.age_s(time.monotonic()) < 0.5


def raw_publisher(config: LinkConfig, open_link: Open) -> Callable[[bytes], None]:
    """Sends any bytes with the localizer's own key."""
    link = open_link(config)
    socket = link.bind("pose", 10**6)

    def send(data: bytes) -> None:
        link.allow_list.admit()
        socket.send(data)

    return send


def test_garbage_is_refused_and_counted_and_the_next_good_message_gets_in(
    configs: Configs, open_link: Open
) -> None:
    send = raw_publisher(configs["localizer"], open_link)
    robot = configs["robot"]
    subscriber = Subscriber(open_link(robot), PosesMessage)

    def refused_one(data: bytes) -> bool:
        before = subscriber.refused

        def tried() -> bool:
            send(data)
            assert subscriber.receive() is None
            return subscriber.refused > before

        return until(tried)

    for data in (b"", b"\x00" * 30, b"{}", POSE.to_bytes().replace(b":1.0", b":NaN", 1)):
        assert refused_one(data), data
        assert subscriber.last_refusal

    def good() -> bool:
        send(POSE.to_bytes())
        return subscriber.receive() is not None

    assert until(good)


def test_an_oversized_message_never_reaches_the_program(configs: Configs, open_link: Open) -> None:
    send = raw_publisher(configs["localizer"], open_link)
    robot = configs["robot"]
    subscriber = Subscriber(open_link(robot), PosesMessage)

    def good() -> bool:
        send(POSE.to_bytes())
        return subscriber.receive() is not None

    assert until(good)
    time.sleep(0.1)
    subscriber.receive()
    for _ in range(20):
        send(b"x" * 100_000)
        time.sleep(0.01)
        assert subscriber.receive() is None
    assert subscriber.refused == 0, "the socket itself refuses it"
    assert until(good), "and hears the next good one"


def test_who_connects_again_need_not_be_connected(configs: Configs, open_link: Open) -> None:
    """libzmq gives an endpoint up for good after a refusal; to leave it then is an error of its."""
    link = open_link(configs["monitor"])
    socket = link.connect("pose", 4096)
    socket.disconnect(configs["monitor"].endpoint("pose"))
    with pytest.raises(zmq.ZMQError):
        socket.disconnect(configs["monitor"].endpoint("pose"))
    link.reconnect(socket, "pose")
    socket.disconnect(configs["monitor"].endpoint("pose"))  # it is connected


def test_a_link_speaks_to_the_hosts_of_its_file(configs: Configs, open_link: Open) -> None:
    config = replace(configs["monitor"], robot_host="robot.local", localizer_host="10.0.0.2")
    assert open_link(config).config == config


@pytest.mark.parametrize(
    "host",
    ["tcp://192.168.1.11", "robot 1", "", "robot:5570", "ä", "192.168..5", "-", ".", "_", "a."],
)
def test_a_host_is_a_name_or_an_address_alone(host: str) -> None:
    for fields in ({"robot_host": host}, {"localizer_host": host}):
        with pytest.raises(ConfigError, match="a name or an IPv4 address alone"):
            LinkConfig("keys", **fields)
    with pytest.raises(ConfigError, match="a name or an IPv4 address alone"):
        LinkConfig("keys", robots=(OtherRobot("a", host),))


def test_who_is_allowed_comes_in_before_anything_is_sent(configs: Configs, open_link: Open) -> None:
    localizer, robot = configs["localizer"], configs["robot"]
    door = open_link(localizer)
    publisher = Publisher(door, PosesMessage)
    link = open_link(robot)
    subscriber = Subscriber(link, PosesMessage)
    for _ in range(10):
        door.allow_list.admit()
        time.sleep(0.05)
    for _ in range(5):  # first messages are lost while the publisher takes note of who came in
        publisher.send(POSE)
        time.sleep(0.01)
    end_s = time.monotonic() + 2.0
    while subscriber.receive() is None:
        assert time.monotonic() < end_s
        time.sleep(0.01)


HANGING_ROBOT = """
import sys, time
from robot.link.command_server import CommandServer
from robot.link.sockets import LinkConfig
config = LinkConfig(sys.argv[1], base_port=int(sys.argv[2]))
with config.open() as link:
    server = CommandServer(link)
    print("open", flush=True)
    for _ in range(200):  # its door is answered, its commands are not
        link.allow_list.admit()
        time.sleep(0.01)
"""


def test_who_floods_a_robot_that_hangs_and_hangs_up_does_not_end_it(configs: Configs) -> None:
    config, keys = configs["robot"], load_keys(configs["monitor"].keys)
    command = [sys.executable, "-c", HANGING_ROBOT, config.keys, str(config.base_port)]
    with subprocess.Popen(command, stdout=subprocess.PIPE) as robot:
        assert robot.stdout is not None
        robot.stdout.readline()
        with zmq.Context() as context:
            for _ in range(4):
                with context.socket(zmq.DEALER) as flood:
                    flood.linger = 0
                    flood.curve_serverkey = keys.peer("robot")
                    flood.curve_publickey, flood.curve_secretkey = keys.public, keys.secret
                    flood.connect(config.endpoint("command"))
                    for _ in range(500):
                        flood.send(bytes(99))
                    time.sleep(0.15)
        assert robot.wait(10.0) == 0
