"""Who may drive a bus, and who may switch it off: real programs on a virtual bus."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple

import pytest

from robot.cli import main
from robot.cli.install import ROOT
from robot.computer.clock import MonotonicClock
from robot.errors import HardwareError
from robot.geometry import WheelSpeeds
from robot.hat.config import HatConfig
from robot.hat.thread import real_motors
from sim_pybullet.virtual.hat import VirtualHat
from sim_pybullet.virtual.i2c import VirtualI2cBus
from tests.tools.test_loop_parts import served
from tools.loop.devices import BusServer

ADDRESS = 0x51  # neither of those that are tried without a configuration
PATIENCE_S = 60.0


class Place(NamedTuple):
    hat: VirtualHat
    config: Path
    settings: HatConfig


@pytest.fixture
def place(tmp_path: Path) -> Iterator[Place]:
    bus = VirtualI2cBus()
    hat = VirtualHat(bus, MonotonicClock(), ADDRESS)
    server = BusServer(tmp_path / "i2c", bus, lambda: None)
    config = tmp_path / "robot.yaml"
    config.write_text(f"model: none.onnx\nhat: {{socket: {server.path}, addresses: [{ADDRESS}]}}\n")
    with served(server):
        settings = HatConfig(socket=str(server.path), addresses=(ADDRESS,))
        yield Place(hat, config, settings)


def eventually(holds: Callable[[], bool]) -> None:
    deadline_s = time.monotonic() + PATIENCE_S
    while not holds():
        assert time.monotonic() < deadline_s, "waited in vain"
        time.sleep(0.005)


def program(command: str, config: Path) -> subprocess.Popen[str]:
    return subprocess.Popen(
        [sys.executable, "-m", "robot", command, "--config", str(config)],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env={**os.environ, "PYTHONPATH": str(ROOT), "PYTHONUNBUFFERED": "1"},
    )


@contextmanager
def a_selftest_with_its_coils_on(place: Place) -> Iterator[subprocess.Popen[str]]:
    with program("selftest", place.config) as owner:
        try:
            assert owner.stdin is not None
            owner.stdin.write("y\n" * 2)
            owner.stdin.flush()
            eventually(lambda: place.hat.chip.outputs.any_high)
            yield owner
        finally:
            owner.kill()


@pytest.mark.usefixtures("hears_signals")
@pytest.mark.parametrize("how", [signal.SIGHUP, signal.SIGTERM, signal.SIGINT])
def test_who_drives_leaves_no_coil_on_whatever_ends_it(place: Place, how: signal.Signals) -> None:
    with a_selftest_with_its_coils_on(place) as owner:
        owner.send_signal(how)
        assert owner.wait(PATIENCE_S) == 130
        eventually(lambda: not place.hat.chip.outputs.any_high)  # the socket may still hold it


def test_a_second_owner_is_refused_in_one_line_and_the_first_drives_on(place: Place) -> None:
    with a_selftest_with_its_coils_on(place) as owner:
        second = program("selftest", place.config)
        told = second.communicate(timeout=PATIENCE_S)[1].splitlines()
        assert second.returncode == 1
        assert len(told) == 1
        assert "another one has the bus" in told[0]
        assert owner.poll() is None
        owner.kill()
        owner.wait()
        with real_motors(place.settings) as motors:  # a killed owner leaves no lock behind
            assert motors.healthy


def test_off_knows_the_configured_bus_and_address(
    place: Place, capsys: pytest.CaptureFixture[str]
) -> None:
    with a_selftest_with_its_coils_on(place) as owner:
        owner.kill()
        owner.wait()
        assert place.hat.chip.outputs.any_high, "the chip has no watchdog"
        assert main(["off", "--config", str(place.config)]) == 0
        assert "all outputs off at 0x51" in capsys.readouterr().out
        assert not place.hat.chip.outputs.any_high


def test_off_works_on_a_robot_that_drives_and_that_one_stays_off(place: Place) -> None:
    failed: list[HardwareError] = []
    with real_motors(place.settings) as motors:

        def drive() -> None:
            while not failed:
                try:
                    motors.set_wheels(WheelSpeeds(0.1, 0.1))
                except HardwareError as error:
                    failed.append(error)
                time.sleep(0.05)

        driving = threading.Thread(target=drive)
        driving.start()
        eventually(lambda: motors.counts[0] > 5)
        assert main(["off", "--config", str(place.config)]) == 0
        assert not place.hat.chip.outputs.any_high
        began_s = time.monotonic()
        eventually(lambda: bool(failed))
        assert time.monotonic() - began_s < 1.0
        driving.join()
        assert "another program released or wrote" in str(failed[0])
        time.sleep(0.3)
        assert not place.hat.chip.outputs.any_high


def test_off_needs_no_lock(place: Place) -> None:
    with real_motors(place.settings) as motors:
        assert main(["off", "--config", str(place.config)]) == 0
        assert motors.healthy, "its coils were off anyway"
