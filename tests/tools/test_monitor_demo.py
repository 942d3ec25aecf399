"""The demonstration's robot is a process that ends with the monitor, however that ends."""

import signal
import subprocess
import sys
from contextlib import closing
from functools import partial
from pathlib import Path

import pytest

from robot.link.config import LinkConfig
from robot.navigation.road_map import load_map
from tests.robot.link.conftest import free_base_port, until
from tools.monitor.demo_robot import DemoRobot

pytestmark = pytest.mark.skipif(not Path("/proc/self/task").exists(), reason="reads Linux's /proc")


@pytest.mark.parametrize("how", [signal.SIGTERM, signal.SIGINT, signal.SIGKILL])
def test_the_robot_ends_with_its_monitor(tmp_path: Path, how: signal.Signals) -> None:
    command = [sys.executable, "-m", "tools.monitor", "--demo", "--port", str(free_base_port())]
    command += ["--map", "loop", "--drives", str(tmp_path / "drives")]
    heeds = partial(signal.signal, signal.SIGINT, signal.SIG_DFL)  # tests may run behind a nohup
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True, preexec_fn=heeds) as monitor:
        assert monitor.stdout is not None
        assert "http" in monitor.stdout.readline()
        children = Path(f"/proc/{monitor.pid}/task/{monitor.pid}/children").read_text().split()
        robots = [c for c in children if "demo_robot" in Path(f"/proc/{c}/cmdline").read_text()]
        assert len(robots) == 1
        monitor.send_signal(how)
        monitor.wait(10.0)
    proc = Path(f"/proc/{robots[0]}/cmdline")
    assert until(lambda: not proc.exists() or not proc.read_text(), 40.0)


@pytest.mark.parametrize(("sees", "driver"), [(True, "dueling"), (False, "pursuit")])
def test_with_eyes_a_shipped_policy_drives(sees: bool, driver: str) -> None:
    config = LinkConfig(plaintext=True, base_port=free_base_port())
    with closing(DemoRobot(load_map("loop"), config, sees)) as robot:
        assert robot.runtime._policy.contract.algorithm == driver
