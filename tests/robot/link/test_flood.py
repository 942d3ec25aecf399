"""1,500 connections that never show a key: the robot keeps its descriptors and its operator."""

from __future__ import annotations

import json
import socket
import subprocess
import sys
import threading
import time
from pathlib import Path
from typing import Callable, Dict, Iterator, List

import pytest

from robot.errors import ConfigError
from robot.link.command_client import CommandClient
from robot.link.command_server import CommandServer
from robot.link.sockets import LinkConfig, raise_limit
from tests.robot.link.conftest import free_base_port, until

pytest.importorskip("zmq")
resource = pytest.importorskip("resource")
linux = pytest.mark.skipif(not sys.platform.startswith("linux"), reason="descriptors of Linux")

CALLERS = 1500
ROBOT = """
import json, os, resource, sys, time
resource.setrlimit(resource.RLIMIT_NOFILE, (int(sys.argv[3]), int(sys.argv[4])))
from robot.link.command_server import CommandServer
from robot.link.sockets import LinkConfig
config = LinkConfig(keys=sys.argv[1], base_port=int(sys.argv[2]))
refused, worst_s, most = 0, 0.0, 0
with config.open() as link:
    server = CommandServer(link)
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
        first = CommandClient(link)
        assert until(beating(first))
        crowd = callers()
        try:
            assert until(beating(first, crowd.came.is_set), 20.0)
            assert until(beating(first))
            began_s = time.monotonic()
            second = CommandClient(late)
            assert until(lambda: bool(first.poll() or True) and beating(second)(), 8.0)
            during_s = time.monotonic() - began_s
        finally:
            crowd.close()
        assert until(beating(first))
    with config.open() as later:
        assert until(beating(CommandClient(later)), 3.0), "and afterwards at once"
    return during_s


ZMTP = b"\xff\x00\x00\x00\x00\x00\x00\x00\x01\x7f\x03\x01CURVE" + bytes(47)


@linux
@pytest.mark.parametrize(
    ("soft", "hard", "greeting", "again"),
    [
        (1024, 4096, b"", False),  # as a robot's system has it
        (1024, 4096, ZMTP, False),  # who knows how to begin, and has no key
        (1024, 4096, b"", True),  # and they never tire
    ],
    ids=["silent", "greeting", "untiring"],
)
def test_callers_without_a_key_use_nothing_up(
    key_folders: Dict[str, Path], soft: int, hard: int, greeting: bytes, again: bool
) -> None:
    port = free_base_port()
    robot = Robot(key_folders["robot"], port, soft, hard)
    try:
        during_s = play(key_folders, port, lambda: Callers(port + 3, greeting, again))
        assert robot.newest["refused"] == 0, "the program can open a file all the time"
        assert robot.newest["worst_s"] < 0.2, "and its loop is not held up"
        assert robot.oldest_operator_s < 1.0, "the operator that is there stays"
        assert during_s < 8.0, "another one comes in"
    finally:
        robot.close()


def test_a_limit_is_raised_to_what_the_system_allows() -> None:
    before = resource.getrlimit(resource.RLIMIT_NOFILE)
    resource.setrlimit(resource.RLIMIT_NOFILE, (700, before[1]))
    try:
        raise_limit()
        assert resource.getrlimit(resource.RLIMIT_NOFILE) == (min(before[1], 65_536), before[1])
    finally:
        resource.setrlimit(resource.RLIMIT_NOFILE, before)


def test_a_port_that_is_taken_is_told_in_one_line(key_folders: Dict[str, Path]) -> None:
    config = LinkConfig(str(key_folders["robot"]), base_port=free_base_port())
    with config.open() as link, config.open() as other:
        CommandServer(link)
        with pytest.raises(ConfigError, match="expected a free port") as caught:
            CommandServer(other)
        assert "\n" not in str(caught.value)
    with config.open() as link:
        CommandServer(link)  # free again since its link was closed
