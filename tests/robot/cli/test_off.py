from __future__ import annotations

import os
import subprocess
import sys

import pytest

from robot.cli import main
from robot.cli.off import switch_off
from robot.errors import HardwareError
from robot.footprint import ROOT
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


def test_an_absent_bus_ends_with_status_one(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["off", "--bus", "250"]) == 1
    assert "/dev/i2c-250: expected an I2C bus" in capsys.readouterr().err
    with pytest.raises(SystemExit) as ended:
        main(["off", "--address", "0x20"])
    assert ended.value.code == 2


def test_it_waits_for_no_heavy_import() -> None:
    code = (
        "import sys; from robot.cli import main; main(['off', '--bus', '250']); "
        "print(sorted({'numpy', 'cv2', 'yaml', 'onnxruntime', 'zmq'} & set(sys.modules)))"
    )
    done = subprocess.run(
        [sys.executable, "-c", code],
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        check=True,
    )
    assert done.stdout.decode().strip() == "[]"
