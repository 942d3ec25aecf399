"""What the figures of a HAT may be, to the edge; and bytes on the bus, one by one."""

from __future__ import annotations

import errno
import math
from dataclasses import replace
from typing import Any, List, Tuple

import pytest

from robot.errors import ConfigError, HardwareError
from robot.hat import bus as module
from robot.hat.bus import (
    Pca9685,
    SmbusBus,
    bus_time_s,
    channel_bytes,
    channel_register,
    open_bus,
)
from robot.hat.config import HatConfig, MotorConfig
from sim_pybullet.virtual.clock import VirtualClock
from tests.robot.hat.rig import full_step_m

SLOW = HatConfig(max_speed_mps=0.1)
EDGES: List[Tuple[str, Any, Any]] = [
    ("bus", 0, -1),
    ("bus_hz", 1_000_000, 1_000_001),
    ("addresses", (0x40,), (0x3F,)),
    ("addresses", (0x77,), (0x78,)),
    ("addresses", (0x6F, 0x71), (0x6F, 0x70)),
    ("run_duty", 1.0, 1.0001),
    ("run_duty", 0.31, 0.3),
    ("hold_duty", 0.0, -0.0001),
    ("hold_duty", 0.9999, 1.0),
    ("start_stop_mps", 0.1, 0.1001),
    ("hold_after_s", 60.0, 60.001),
    ("acceleration_mps2", 1e-6, 0.0),
    ("max_speed_mps", 0.05, math.inf),
    ("release_after_s", 0.25, 0.0),
    ("command_timeout_s", 1e-6, -1.0),
    ("steps_per_rev", 48.5, 0),  # a geared motor's are no whole number: 2037.9 of a 28BYJ-48
    ("microsteps", 2, 3),
]


@pytest.mark.parametrize(("name", "good", "bad"), EDGES)
def test_a_setting_is_taken_up_to_its_edge(name: str, good: Any, bad: Any) -> None:
    base = replace(SLOW, run_duty=1.0) if name == "hold_duty" else SLOW
    assert getattr(replace(base, **{name: good}), name) == good
    with pytest.raises(ConfigError, match=name):
        replace(base, **{name: bad})


@pytest.mark.parametrize(
    ("gain", "fits"), [(1.1, True), (1.101, False), (0.9091, True), (0.909, False)]
)
def test_wheels_differ_by_a_tenth_at_most(gain: float, fits: bool) -> None:
    if fits:
        assert MotorConfig("M1M2", gain=gain).gain == gain
    else:
        with pytest.raises(ConfigError, match=r"expected 0\.91 to 1\.10"):
            MotorConfig("M1M2", gain=gain)
    assert MotorConfig("M1M2") == MotorConfig("M1M2", False, 1.0)


@pytest.mark.parametrize(
    ("microsteps", "bus_hz", "fastest_mps"),
    [(1, 100_000, 0.8955), (2, 100_000, 0.4478), (4, 400_000, 0.6570), (8, 400_000, 0.3285)],
)
def test_stepping_takes_four_fifths_of_the_bus(
    microsteps: int, bus_hz: int, fastest_mps: float
) -> None:
    """41 bytes for a step of both motors, from a quarter step on 49 and a look at four."""
    config = HatConfig(microsteps=microsteps, bus_hz=bus_hz, max_speed_mps=0.1)
    bits = 9 * 42 + 2 if microsteps <= 2 else 9 * 50 + 2 + 9 * 7 + 3
    edge_mps = 0.8 * bus_hz / bits * config.step_m
    assert edge_mps == pytest.approx(fastest_mps, rel=1e-3)
    replace(config, max_speed_mps=0.999 * edge_mps)
    with pytest.raises(ConfigError, match="use fewer microsteps, a lower speed or a faster bus"):
        replace(config, max_speed_mps=1.001 * edge_mps)
    smaller = MotorConfig("M1M2", gain=0.95)
    with pytest.raises(ConfigError, match="updates per second"):
        replace(config, max_speed_mps=0.999 * edge_mps, left=smaller)


def test_how_far_a_wheel_rolls_in_a_step() -> None:
    config = HatConfig(left=MotorConfig("M1M2", gain=1.02), right=MotorConfig("M3M4", True, 0.97))
    around_m = 2.0 * math.pi * config.drive.wheel_radius_m
    assert full_step_m(config) == pytest.approx(around_m / config.steps_per_rev)
    assert config.step_m == pytest.approx(full_step_m(config) / config.microsteps)
    assert config.wheel_steps_m == pytest.approx((1.02 * config.step_m, 0.97 * config.step_m))


def test_times_on_the_wire() -> None:
    """Nine bits a byte; an address before all, and a second one before what is read."""
    assert bus_time_s(1, 1) == 9 * 2 + 2
    assert bus_time_s(10, 400_000) == pytest.approx((9 * 11 + 2) / 400_000)
    assert bus_time_s(2, 1, 2) == 9 * 4 + 3
    assert bus_time_s(5, 100_000, 2) == pytest.approx((9 * 7 + 3) / 100_000)


def test_a_number_is_a_device_and_a_path_is_a_socket(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "SmbusBus", lambda number: ("device", number))
    monkeypatch.setattr(module, "SocketBus", lambda path: ("socket", path))
    assert open_bus(3) == ("device", 3)  # type: ignore[comparison-overlap]
    assert open_bus("/tmp/x") == ("socket", "/tmp/x")  # type: ignore[comparison-overlap]


def test_a_virtual_bus_may_be_silent_for_a_second(monkeypatch: pytest.MonkeyPatch) -> None:
    """As long as Linux's adapters wait: a busy computer is no dead bus."""
    asked: List[Any] = []
    monkeypatch.setattr(module, "connect_local", lambda *told: asked.append(told))
    module.SocketBus("/tmp/x")
    assert asked == [("/tmp/x", "a virtual I2C bus", 1.0)]


@pytest.mark.parametrize(
    ("number", "says"),
    [(errno.EACCES, "add the user to the group i2c"), (errno.ENOENT, "expected an I2C bus, got")],
)
def test_why_a_device_cannot_be_opened(
    monkeypatch: pytest.MonkeyPatch, number: int, says: str
) -> None:
    import smbus2

    def refuse(_: int) -> Any:
        raise OSError(number, "why")

    monkeypatch.setattr(smbus2, "SMBus", refuse)
    with pytest.raises(HardwareError, match=f"/dev/i2c-4: .*{says}"):
        SmbusBus(4)


@pytest.mark.parametrize(
    ("level", "expected"),
    [
        (0.0, "00000010"),
        (-0.1, "00000010"),
        (0.0001, "00000010"),
        (0.0002, "00000100"),
        (0.5, "00000008"),
        (0.3, "0000cd04"),
        (0.9998, "0000ff0f"),
        (0.9999, "00100000"),
        (1.0, "00100000"),
        (1.1, "00100000"),
    ],
)
def test_the_bytes_of_a_level(level: float, expected: str) -> None:
    assert channel_bytes(level).hex() == expected


def test_channels_have_four_registers_from_six_on() -> None:
    assert [channel_register(channel) for channel in (0, 1, 15)] == [0x06, 0x0A, 0x42]


class Registers:
    """A bus that answers what it is told to, and keeps what was written."""

    name = "bus"

    def __init__(self, **values: int) -> None:
        self.values = {0x00: 0x20, 0x01: 0x04, 0xFE: 0x03}
        self.values.update({int(key[1:], 16): value for key, value in values.items()})
        self.written: List[bytes] = []

    def write(self, address: int, data: bytes) -> None:
        assert address == 0x6F
        self.written.append(data)

    def read(self, address: int, register: int, count: int) -> bytes:
        assert address == 0x6F
        return bytes(self.values.get(register + k, 0) for k in range(count))


def chip(**values: int) -> Tuple[Pca9685, Registers]:
    bus = Registers(**values)
    return Pca9685(bus, 0x6F, VirtualClock()), bus


def test_setting_up_is_six_messages_and_half_a_millisecond() -> None:
    one, bus = chip()
    one.initialise()
    assert [data.hex() for data in bus.written] == ["fd10", "0030", "fe03", "0020", "0104"]
    assert one._clock.now() == pytest.approx(500e-6)


@pytest.mark.parametrize(("register", "value"), [("r00", 0x21), ("r01", 0x05), ("rfe", 0x04)])
def test_each_mode_is_looked_at(register: str, value: int) -> None:
    one, _ = chip(**{register: value})
    with pytest.raises(HardwareError, match=f"got 0x{value:02X}; the chip was reset"):
        one.check()
    with pytest.raises(HardwareError, match="the chip was reset"):
        one.initialise()


@pytest.mark.parametrize(
    ("values", "ours"),
    [
        ({}, True),
        ({"rfe": 0x02}, False),
        ({"r01": 0x24}, False),
        ({"r01": 0x1F, "rfe": 0xFF}, True),
    ],
)
def test_who_is_taken_for_the_chip(values: Any, ours: bool) -> None:
    _, bus = chip(**values)
    assert (Pca9685.find(bus, 0x6F, VirtualClock()) is not None) is ours
    assert bus.written == []


def test_a_channel_that_was_written_by_another_is_told_unless_the_chip_was_reset() -> None:
    one, bus = chip(r12=0x00, r13=0x00, r14=0x00, r15=0x10)
    one.expect_channel(3, 0.0)
    with pytest.raises(HardwareError, match=r"wrote channel 3 .*expected 00100000, got 00000010"):
        one.expect_channel(3, 1.0)
    bus.values[0x00] = 0x31
    with pytest.raises(HardwareError, match="expected MODE1 = 0x20, got 0x31"):
        one.expect_channel(3, 1.0)


def test_a_chip_is_off_when_every_channel_is() -> None:
    one, bus = chip(**{f"r{0x09 + 4 * k:02x}": 0x10 for k in range(16)})
    assert one.is_off()
    for k in (0, 7, 15):
        bus.values[0x09 + 4 * k] = 0x0F
        assert not one.is_off()
        bus.values[0x09 + 4 * k] = 0x1F
    assert one.is_off()
