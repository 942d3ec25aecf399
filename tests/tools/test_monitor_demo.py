"""The demonstration: the page on the bench, whose programs end with it, however that ends."""

import re
import signal
import subprocess
import sys
from functools import partial
from pathlib import Path

import pytest

from tests.robot.link.conftest import free_base_port, until
from tests.thorough import count
from tools.loop.operator import Operator
from tools.loop.timekeeper import Timekeeper

pytestmark = pytest.mark.skipif(not Path("/proc/self/task").exists(), reason="reads Linux's /proc")


def said(command: str) -> str:
    """What a process was called with; empty once it is over."""
    proc = Path(f"/proc/{command}/cmdline")
    return proc.read_text() if proc.exists() else ""


HOW = [signal.SIGKILL, signal.SIGINT, signal.SIGTERM]


@pytest.mark.slow
@pytest.mark.parametrize("how", HOW[: count(1, 3)])
def test_the_robot_ends_with_its_monitor(tmp_path: Path, how: signal.Signals) -> None:
    command = [sys.executable, "-m", "tools.monitor", "--demo", "--port", str(free_base_port())]
    command += ["--map", "loop", "--drives", str(tmp_path / "drives")]
    heeds = partial(signal.signal, signal.SIGINT, signal.SIG_DFL)  # tests may run behind a nohup
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True, preexec_fn=heeds) as monitor:
        assert monitor.stdout is not None
        address = re.search(r":([0-9]+)/\?token=(\S+)", monitor.stdout.readline())
        assert address is not None
        page = Operator(Timekeeper(), int(address[1]), address[2])

        def shown() -> bool:
            page.turn()
            return page.state == "DISARMED" and bool(page.robot["pose"])

        assert until(shown, 60.0)
        children = Path(f"/proc/{monitor.pid}/task/{monitor.pid}/children").read_text().split()
        programs = [child for child in children if "tools.loop.in_step" in said(child)]
        assert len(programs) == 3
        monitor.send_signal(how)
        monitor.wait(10.0)
    assert until(lambda: not any(map(said, programs)), 40.0)
