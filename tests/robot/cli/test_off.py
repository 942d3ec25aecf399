from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path
from typing import List

import pytest

from robot.cli import main, off
from robot.cli.install import ROOT
from robot.cli.off import configured, switch_off
from robot.errors import HardwareError
from sim_pybullet.virtual.hat import VirtualHat
from sim_pybullet.virtual.i2c import BusFault, VirtualI2cBus
from tests.robot.hat.rig import make_rig


@pytest.mark.parametrize("address", [0x6F, 0x60])
def test_the_coils_of_a_program_that_was_killed_are_switched_off(address: int) -> None:
    rig = make_rig()
    if address == 0x60:
        VirtualHat(rig.bus, rig.clock, address)
        rig.bus._devices.pop(0)  # the HAT at 0x6F
        rig.hat.chip = rig.bus._devices[0]
    rig.driver.open()
    rig.drive(0.2, 0.2, 1.0)
    assert rig.hat.chip.outputs.any_high
    told = switch_off(rig.bus, [0x6F, 0x60], rig.clock)
    assert told == f"virtual I2C bus: all outputs off at 0x{address:02X}"
    assert not rig.hat.chip.outputs.any_high


def test_it_tries_again_and_says_when_only_the_supply_can_help() -> None:
    rig = make_rig()
    rig.driver.open()
    rig.drive(0.2, 0.2, 1.0)
    rig.bus.inject(BusFault.STUCK, count=2, after=3)
    assert switch_off(rig.bus, [0x6F], rig.clock)
    assert not rig.hat.chip.outputs.any_high
    rig.bus.inject(BusFault.STUCK, count=100)
    with pytest.raises(HardwareError, match="cut the motor supply"):
        switch_off(rig.bus, [0x6F], rig.clock)


def test_a_bus_without_a_hat_is_left_alone() -> None:
    rig = make_rig()
    assert switch_off(VirtualI2cBus(), [0x6F, 0x60], rig.clock) == ""


def test_where_no_hat_is_found_nobody_is_told_that_all_is_off(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(off, "open_bus", lambda _: VirtualI2cBus())
    monkeypatch.setattr(off.os.path, "exists", lambda path: path == "/dev/i2c-7")
    assert main(["off"]) == 1
    told = capsys.readouterr()
    assert (told.out, told.err) == ("", "robot off: expected a HAT on bus 7, found none\n")


def test_a_program_that_switches_the_coils_on_again_is_told() -> None:
    rig = make_rig()
    rig.driver.open()
    rig.drive(0.2, 0.2, 1.0)
    sent = rig.bus.write

    def contradict(address: int, data: bytes) -> None:
        sent(address, data)
        if data == b"\xfd\x10":
            contradicted.append(address)
            sent(0x6F, bytes((0x12, 0, 0x10, 0, 0)))

    contradicted: List[int] = []
    rig.bus.write = contradict  # type: ignore[method-assign]
    with pytest.raises(HardwareError, match="another program switches the motors on again"):
        switch_off(rig.bus, [0x6F], rig.clock)
    assert len(contradicted) >= 10
    contradicted.clear()
    rig.bus.write = lambda a, d: (contradict if len(contradicted) < 2 else sent)(a, d)  # type: ignore[method-assign]
    assert switch_off(rig.bus, [0x6F], rig.clock)
    assert not rig.hat.chip.outputs.any_high


def test_it_waits_for_a_program_that_switches_the_coils_on_again_a_moment_later() -> None:
    """A drive's turn comes every tenth of a second, its watchdog looks every twentieth."""
    rig = make_rig()
    rig.driver.open()
    rig.drive(0.2, 0.2, 1.0)
    rounds: List[float] = []

    class Contradicting:
        def now(self) -> float:
            return rig.clock.now()

        def sleep(self, duration_s: float) -> None:
            rig.clock.sleep(duration_s)
            if duration_s >= 0.04 and len(rounds) < 9:
                rounds.append(duration_s)
                rig.bus.write(0x6F, bytes((0x12, 0, 0x10, 0, 0)))

    assert switch_off(rig.bus, [0x6F], Contradicting())
    assert len(rounds) == 9
    assert not rig.hat.chip.outputs.any_high


@pytest.mark.parametrize(
    ("text", "place"),
    [
        ("hat: {bus: 7, addresses: [0x6D]}", (7, [0x6D])),
        ("hat: {addresses: ['0x6E', 0x60]}", (1, [0x6E, 0x60])),
        ("hat: {addresses: [0x40, 0x77]}", (1, [0x40, 0x77])),
        ("hat: {socket: /run/i2c}", ("/run/i2c", [0x6F, 0x60])),
        ("model: lane.onnx", (1, [0x6F, 0x60])),
        ("", (1, [0x6F, 0x60])),
    ],
)
def test_bus_and_addresses_come_from_the_configuration(
    tmp_path: Path, text: str, place: tuple
) -> None:
    (tmp_path / "robot.yaml").write_text(text)
    assert configured(tmp_path / "robot.yaml") == place


@pytest.mark.parametrize(
    "text", ["hat: 3", "hat: {bus: one}", "hat: {addresses: [0x20]}", "{", "- 1", "hat: [", None]
)
def test_an_unreadable_configuration_is_told_after_the_usual_places_were_switched_off(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], text: str
) -> None:
    rig = make_rig()
    rig.driver.open()
    rig.drive(0.2, 0.2, 1.0)
    monkeypatch.setattr(off, "open_bus", lambda bus: rig.bus)
    config = tmp_path / "robot.yaml"
    if text is not None:
        config.write_text(text)
    assert main(["off", "--config", str(config)]) == 2
    told = capsys.readouterr()
    assert "all outputs off at 0x6F" in told.out
    assert told.err.startswith(f"robot off: {config}: expected a robot's YAML with its hat")
    assert len(told.err.splitlines()) == 1
    assert not rig.hat.chip.outputs.any_high


def test_a_bus_that_is_stuck_keeps_the_hat_on_no_other_one_hot(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    rig = make_rig()
    rig.driver.open()
    rig.drive(0.2, 0.2, 1.0)
    stuck = make_rig().bus
    stuck.inject(BusFault.STUCK, count=1_000)
    monkeypatch.setattr(off, "open_bus", {1: stuck, 7: rig.bus}.get)
    there = ("/dev/i2c-1", "/dev/i2c-7")
    monkeypatch.setattr(off.os.path, "exists", lambda path: path in there)
    assert main(["off"]) == 1
    told = capsys.readouterr()
    assert "all outputs off at 0x6F" in told.out
    assert "cut the motor supply" in told.err
    assert not rig.hat.chip.outputs.any_high


def test_a_hat_that_stays_on_is_told_before_a_wrong_configuration(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    rig = make_rig()
    rig.bus.inject(BusFault.STUCK, count=1_000)
    monkeypatch.setattr(off, "open_bus", lambda bus: rig.bus)
    (tmp_path / "robot.yaml").write_text("hat: 3")
    assert main(["off", "--config", str(tmp_path / "robot.yaml")]) == 1
    assert "cut the motor supply" in capsys.readouterr().err


def test_an_absent_bus_ends_with_status_one(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "robot.yaml").write_text("hat: {bus: 250}")
    assert main(["off", "--config", str(tmp_path / "robot.yaml")]) == 1
    assert "/dev/i2c-250: expected an I2C bus" in capsys.readouterr().err


@pytest.mark.parametrize("configured", [False, True])
def test_it_waits_for_no_heavy_import(tmp_path: Path, configured: bool) -> None:
    config = tmp_path / "robot.yaml"
    config.write_text("hat: {bus: 250}")
    words = ["off", "--config", str(config)] if configured else ["off"]
    code = (
        f"import sys; from robot.cli import main; main({words!r}); "
        "print(sorted({'numpy', 'cv2', 'yaml', 'onnxruntime', 'zmq'} & set(sys.modules)))"
    )
    done = subprocess.run(
        [sys.executable, "-c", code],
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        check=True,
    )
    assert done.stdout.decode().strip() == ("['yaml']" if configured else "[]")
