"""Loopback links for the tests: free ports, keys of three machines, waiting with a deadline."""

from __future__ import annotations

import socket
import time
from contextlib import ExitStack
from pathlib import Path
from typing import Callable, Iterator

import pytest

from robot.link.keys import BOUND_BY, keygen
from robot.link.sockets import Link, LinkConfig


def free_base_port() -> int:
    """A port with the next ones free as well."""
    for _ in range(50):
        with ExitStack() as stack:
            first = stack.enter_context(socket.socket())
            first.bind(("127.0.0.1", 0))
            base = first.getsockname()[1]
            if base + len(BOUND_BY) > 65535:
                continue
            try:
                for offset in range(1, len(BOUND_BY)):
                    stack.enter_context(socket.socket()).bind(("127.0.0.1", base + offset))
            except OSError:
                continue
            return base
    raise OSError("no free ports")


def until(condition: Callable[[], bool], timeout_s: float = 5.0) -> bool:
    """Whether the condition came true within the time; asks every 5 ms."""
    deadline_s = time.monotonic() + timeout_s
    while time.monotonic() < deadline_s:
        if condition():
            return True
        time.sleep(0.005)
    return condition()


@pytest.fixture(scope="session")
def key_folders(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    pytest.importorskip("zmq")
    return keygen(tmp_path_factory.mktemp("keys"))


def configs_of(key_folders: dict[str, Path], base_port: int) -> dict[str, LinkConfig]:
    """The configuration of each machine, with its keys."""
    return {name: LinkConfig(str(keys), base_port=base_port) for name, keys in key_folders.items()}


@pytest.fixture
def configs(key_folders: dict[str, Path]) -> dict[str, LinkConfig]:
    """The configuration of each machine, with keys, on free loopback ports."""
    return configs_of(key_folders, free_base_port())


@pytest.fixture
def open_link() -> Iterator[Callable[[LinkConfig], Link]]:
    """Opens links that are closed when the test ends."""
    with ExitStack() as stack:
        yield lambda config: stack.enter_context(config.open())
