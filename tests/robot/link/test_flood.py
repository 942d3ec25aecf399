"""1,500 connections that never show a key: the robot keeps its descriptors and its operator."""

from __future__ import annotations

import ctypes
import json
import os
import socket
import struct
import subprocess
import sys
import threading
import time
from pathlib import Path
from typing import Callable, Dict, Iterator, List

import pytest

from robot.errors import ConfigError
from robot.link.command_client import CommandClient
from robot.link.config import LinkConfig
from robot.link.listener import Listeners, lowest_free, raise_limit
from tests.robot.link.conftest import free_base_port, until

pytest.importorskip("zmq")
resource = pytest.importorskip("resource")
linux = pytest.mark.skipif(not sys.platform.startswith("linux"), reason="a filter of Linux")

CALLERS = 1500
ROBOT = """
import json, os, resource, sys, time
resource.setrlimit(resource.RLIMIT_NOFILE, (int(sys.argv[3]), int(sys.argv[4])))
from robot.link.config import LinkConfig
config = LinkConfig(keys=sys.argv[1], base_port=int(sys.argv[2]))
refused, worst_s, most = 0, 0.0, 0
with config.open() as link:
    server = config.command_server(link)
    print("open", flush=True)
    told_s = time.monotonic()
    while True:
        began_s = time.monotonic()
        server.serve(lambda command: None)
        worst_s = max(worst_s, time.monotonic() - began_s)
        try:
            number = os.open("/dev/null", os.O_RDONLY)
            os.close(number)
            most = max(most, number)
        except OSError:
            refused += 1
        if began_s - told_s > 0.1:
            told_s = began_s
            told = dict(refused=refused, worst_s=worst_s, most=most, age_s=server.operator_age_s())
            print(json.dumps(told), flush=True)
        time.sleep(0.01)
"""


class Robot:
    """The robot's ear as a process of its own, with so many descriptors."""

    def __init__(self, keys: Path, base_port: int, soft: int, hard: int) -> None:
        command = [sys.executable, "-c", ROBOT, str(keys), str(base_port), str(soft), str(hard)]
        self._process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
        assert self._process.stdout is not None
        assert self._process.stdout.readline() == "open\n"
        self.newest: Dict[str, float] = {}
        self.oldest_operator_s = 0.0
        threading.Thread(target=self._listen, daemon=True).start()

    def _listen(self) -> None:
        assert self._process.stdout is not None
        for line in self._process.stdout:
            told = json.loads(line)
            if self.newest and told["age_s"] < 1e6:
                self.oldest_operator_s = max(self.oldest_operator_s, told["age_s"])
            self.newest = told

    def close(self) -> None:
        self._process.kill()
        self._process.wait(5.0)


class Callers:
    """A crowd that calls, says ``greeting``, and hangs on; it calls again when put out."""

    def __init__(self, port: int, greeting: bytes = b"", again: bool = False) -> None:
        self._port, self._greeting, self._again = port, greeting, again
        self._sockets: List[socket.socket] = []
        self._ending = threading.Event()
        self.came = threading.Event()
        self._thread = threading.Thread(target=self._call, daemon=True)
        self._thread.start()

    def _call(self) -> None:
        while not self._ending.is_set():
            for _ in range(CALLERS):
                caller = socket.socket()
                caller.settimeout(0.2)
                if caller.connect_ex(("127.0.0.1", self._port)) == 0 and self._greeting:
                    caller.send(self._greeting)
                self._sockets.append(caller)
                if self._ending.is_set():
                    return
            self.came.set()
            if not self._again:
                return
            self._hang_up()

    def _hang_up(self) -> None:
        for caller in self._sockets:
            caller.close()
        self._sockets.clear()

    def close(self) -> None:
        self._ending.set()
        self._thread.join(5.0)
        self._hang_up()


@pytest.fixture(autouse=True)
def descriptors() -> Iterator[None]:
    """Enough for the crowd in this process."""
    before = resource.getrlimit(resource.RLIMIT_NOFILE)
    if before[1] < 2500:
        pytest.skip("too few descriptors to play a crowd")
    resource.setrlimit(resource.RLIMIT_NOFILE, (max(before[0], 2500), before[1]))
    yield
    resource.setrlimit(resource.RLIMIT_NOFILE, before)


def filters_allowed() -> bool:
    """Whether this user may attach a filter to a socket: some systems let the root only."""
    with socket.socket() as probe:
        instruction = ctypes.create_string_buffer(struct.pack("=HBBI", 0x06, 0, 0, 0))
        program = struct.pack("HP", 1, ctypes.addressof(instruction))
        try:
            probe.setsockopt(socket.SOL_SOCKET, 26, program)
        except OSError:
            return False
    return True


filters = pytest.mark.skipif(not filters_allowed(), reason="this user may attach no socket filter")


def beating(client: CommandClient, others: Callable[[], bool] = lambda: True) -> Callable[[], bool]:
    def heard() -> bool:
        client.poll()
        time.sleep(0.01)
        return client.silence_s() < 0.5 and others()

    return heard


def play(key_folders: Dict[str, Path], port: int, callers: Callable[[], Callers]) -> float:
    """An operator is there, the crowd comes; how long a second operator takes to get in [s]."""
    config = LinkConfig(keys=str(key_folders["monitor"]), base_port=port)
    with config.open() as link, config.open() as late:
        first = config.command_client(link)
        assert until(beating(first))
        crowd = callers()
        try:
            assert until(beating(first, crowd.came.is_set), 20.0)
            assert until(beating(first))
            began_s = time.monotonic()
            second = config.command_client(late)
            assert until(lambda: bool(first.poll() or True) and beating(second)(), 8.0)
            during_s = time.monotonic() - began_s
        finally:
            crowd.close()
        assert until(beating(first))
    with config.open() as later:
        assert until(beating(config.command_client(later)), 3.0), "and afterwards at once"
    return during_s


ZMTP = b"\xff\x00\x00\x00\x00\x00\x00\x00\x01\x7f\x03\x01CURVE" + bytes(47)


@linux
@pytest.mark.parametrize(
    ("soft", "hard", "greeting", "again"),
    [
        (1024, 4096, b"", False),  # as a robot's system has it
        (1024, 4096, ZMTP, False),  # who knows how to begin, and has no key
        # fewer than callers: some must be shut out
        pytest.param(1024, 1024, b"", False, marks=filters),
        (1024, 4096, b"", True),  # and they never tire
    ],
    ids=["silent", "greeting", "few descriptors", "untiring"],
)
def test_callers_without_a_key_use_nothing_up(
    key_folders: Dict[str, Path], soft: int, hard: int, greeting: bytes, again: bool
) -> None:
    port = free_base_port()
    robot = Robot(key_folders["robot"], port, soft, hard)
    try:
        during_s = play(key_folders, port, lambda: Callers(port + 3, greeting, again))
        if hard > 1500:  # a crowd that is larger than the limit may be faster than the guard
            assert robot.newest["refused"] == 0, "the program can open a file all the time"
        assert robot.newest["worst_s"] < 0.2, "and its loop is not held up"
        assert robot.oldest_operator_s < 1.0, "the operator that is there stays"
        assert during_s < 8.0, "another one comes in"
    finally:
        robot.close()


@linux
@filters
def test_the_door_is_shut_at_half_and_open_again_below_two_fifths(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    from robot.link import listener as module

    used = [0]
    monkeypatch.setattr(module, "raise_limit", lambda: 1000)
    monkeypatch.setattr(module, "lowest_free", lambda: used[0])
    listeners = Listeners()
    port = free_base_port()
    taken = socket.socket(fileno=listeners.listen(f"tcp://127.0.0.1:{port}"))

    def comes_in() -> bool:
        with socket.socket() as caller:
            caller.settimeout(0.2)
            return caller.connect_ex(("127.0.0.1", port)) == 0

    inside = socket.create_connection(("127.0.0.1", port))
    for used[0], open_then in ((499, True), (500, False), (400, False), (399, True), (499, True)):
        listeners.guard()
        assert comes_in() is open_then, used
        assert listeners.shut is not open_then
    used[0] = 500
    listeners.guard()
    inside.send(b"x")
    taken.setblocking(True)
    accepted = taken.accept()[0]
    assert accepted.recv(1) == b"x", "who is in is heard while the door is shut"
    listeners.close()
    for one in (inside, taken, accepted):
        one.close()


@filters
def test_a_program_without_a_descriptor_counts_as_full(monkeypatch: pytest.MonkeyPatch) -> None:
    from robot.link import listener as module

    listeners = Listeners()
    port = free_base_port()
    descriptor = listeners.listen(f"tcp://127.0.0.1:{port}")

    def none_left() -> int:
        raise OSError(24, "Too many open files")

    monkeypatch.setattr(module, "lowest_free", none_left)
    listeners.guard()
    assert listeners.shut is sys.platform.startswith("linux")
    listeners.close()
    socket.socket(fileno=descriptor).close()


def test_a_limit_is_raised_to_what_the_system_allows() -> None:
    before = resource.getrlimit(resource.RLIMIT_NOFILE)
    resource.setrlimit(resource.RLIMIT_NOFILE, (700, before[1]))
    try:
        assert raise_limit() == min(before[1], 65_536)
        assert resource.getrlimit(resource.RLIMIT_NOFILE) == (min(before[1], 65_536), before[1])
    finally:
        resource.setrlimit(resource.RLIMIT_NOFILE, before)


def test_the_next_descriptor_tells_how_many_are_in_use() -> None:
    first = lowest_free()
    with open("/dev/null", "rb"):
        assert lowest_free() == first + 1
    assert lowest_free() == first


def test_a_port_that_is_taken_is_told_in_one_line() -> None:
    port = free_base_port()
    config = LinkConfig(plaintext=True, base_port=port)
    with config.open() as link, config.open() as other:
        config.command_server(link)
        with pytest.raises(ConfigError, match="expected a free port") as caught:
            config.command_server(other)
        assert "\n" not in str(caught.value)
    with config.open() as link:
        config.command_server(link)  # free again since its link was closed


@linux
def test_where_filters_are_forbidden_the_program_goes_on(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    from robot.link import listener as module

    def forbidden(listeners: Listeners, option: int, value: bytes) -> None:
        raise PermissionError(1, "Operation not permitted")

    monkeypatch.setattr(module, "lowest_free", lambda: 10**9)
    monkeypatch.setattr(Listeners, "_set", forbidden)
    listeners = Listeners()
    descriptor = listeners.listen(f"tcp://127.0.0.1:{free_base_port()}")
    for _ in range(3):
        listeners.guard()
        assert not listeners.shut
    assert caplog.text.count("forbids filters") == 1
    listeners.close()
    os.close(descriptor)
