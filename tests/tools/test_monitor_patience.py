"""The monitor as a program: a crowd that connects and asks nothing, and messages of any size."""

import json
import socket
import subprocess
import sys
import time
import urllib.error
import urllib.request
from collections.abc import Iterator
from pathlib import Path

import pytest
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import ClientConnection, connect

from tests.robot.link.conftest import free_base_port, until

resource = pytest.importorskip("resource")
CALLERS = 1500


@pytest.fixture
def monitor(tmp_path: Path) -> Iterator[tuple[int, str, int]]:
    """Port, cookie and process id of a monitor without a robot."""
    config, port = tmp_path / "link.yaml", free_base_port()
    config.write_text(json.dumps({"plaintext": True, "base_port": free_base_port()}))
    command = [sys.executable, "-m", "tools.monitor", "--link", str(config), "--map", "loop"]
    command += ["--port", str(port), "--drives", str(tmp_path / "drives")]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        address = process.stdout.readline().split()[1]
        assert until(lambda: answers(port), 10.0)
        with urllib.request.urlopen(address) as answer:
            cookie = answer.headers["Set-Cookie"].split(";")[0]
        yield port, cookie, process.pid
        process.kill()


def answers(port: int) -> bool:
    try:
        urllib.request.urlopen(f"http://127.0.0.1:{port}/", timeout=2.0)
    except urllib.error.HTTPError as error:
        return error.code == 401
    except OSError:
        return False
    return False


def read_on(page: ClientConnection) -> None:
    while True:
        page.recv(timeout=2.0)


def descriptors(process: int) -> int:
    return len(list(Path(f"/proc/{process}/fd").iterdir()))


@pytest.mark.skipif(not Path("/proc/self/fd").exists(), reason="counts descriptors as Linux does")
def test_a_crowd_that_asks_nothing_is_put_out_and_an_open_page_stays(
    monitor: tuple[int, str, int],
) -> None:
    port, cookie, process = monitor
    before = resource.getrlimit(resource.RLIMIT_NOFILE)
    if before[1] < 2500:
        pytest.skip("too few descriptors to play a crowd")
    resource.setrlimit(resource.RLIMIT_NOFILE, (max(before[0], 2500), before[1]))
    headers = {"Cookie": cookie, "Origin": f"http://127.0.0.1:{port}"}
    idle = descriptors(process)
    with connect(f"ws://127.0.0.1:{port}/ws", additional_headers=headers) as page:
        crowd = [socket.create_connection(("127.0.0.1", port)) for _ in range(CALLERS)]
        for caller in crowd[::2]:
            caller.send(b"GET / HTTP/1.1\r\nHost: ")
        assert answers(port), "somebody who asks is answered"
        began_s = time.monotonic()
        while time.monotonic() - began_s < 14.0 and descriptors(process) > idle + 10:
            assert page.recv(timeout=2.0)
            page.send("seen")
        assert descriptors(process) <= idle + 10
        assert page.recv(timeout=2.0)
        for caller in crowd:
            caller.close()
    resource.setrlimit(resource.RLIMIT_NOFILE, before)


def test_a_message_larger_than_any_of_ours_ends_its_page_alone(
    monitor: tuple[int, str, int],
) -> None:
    port, cookie, _ = monitor
    headers = {"Cookie": cookie, "Origin": f"http://127.0.0.1:{port}"}
    address = f"ws://127.0.0.1:{port}/ws"
    with connect(address, additional_headers=headers) as page:
        with connect(address, additional_headers=headers) as other:
            other.send("[" * 2000 + "]" * 2000)
            assert other.recv(timeout=2.0)
            other.send("x" * 4097)
            with pytest.raises(ConnectionClosed):
                read_on(other)
        assert page.recv(timeout=2.0)
