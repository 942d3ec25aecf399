from itertools import product

import pytest
import smbus2
from hypothesis import given
from hypothesis import strategies as st
from smbus2.smbus2 import I2C_M_RD

from robot.computer.clock import MonotonicClock
from robot.errors import HardwareError
from robot.hat.bus import Pca9685, SmbusBus, bus_time_s, channel_bytes
from robot.hat.config import HatConfig
from sim_pybullet.virtual.clock import VirtualClock
from sim_pybullet.virtual.hat import VirtualHat
from sim_pybullet.virtual.i2c import BusFault, VirtualI2cBus
from sim_pybullet.virtual.pca9685_registers import Output, Pca9685Registers
from tests.robot.hat.rig import WatchedBus, duty


class RealTimeClockChip:
    """A stranger that also lives at 0x6F, and must not be written to."""

    address = 0x6F

    def write(self, data: bytes) -> bool:
        assert data in (b"\x00", b"\x01", b"\xfe"), "only a register number may be sent"
        return True

    def read(self, register: int, count: int) -> bytes:
        return b"\xe5" * count


@pytest.mark.parametrize("address", [0x6F, 0x60])
def test_probe_finds_the_board_at_either_address_without_writing(address: int) -> None:
    clock, bus = VirtualClock(), WatchedBus()
    bus.attach(Pca9685Registers(address, clock))
    assert Pca9685.probe(bus, (0x6F, 0x60), clock).address == address
    assert all(t.read_count == 1 and len(t.data) == 1 for t in bus.log)


def test_nobody_there_is_told_with_what_to_check() -> None:
    with pytest.raises(HardwareError, match=r"0x6F, 0x60, nobody answered; check that the HAT"):
        Pca9685.probe(VirtualI2cBus(), (0x6F, 0x60), VirtualClock())


@pytest.mark.parametrize("number", [6, 121])
def test_that_nobody_answers_is_told_by_either_error_number(number: int) -> None:
    """ENXIO or EREMOTEIO: which of them is the adapter's choice."""

    class Silent(VirtualI2cBus):
        def read(self, address: int, register: int, count: int) -> bytes:
            raise OSError(number, "nobody")

    assert Pca9685.find(Silent(), 0x60, VirtualClock()) is None
    with pytest.raises(HardwareError, match="nobody answered"):
        Pca9685.probe(Silent(), (0x6F, 0x60), VirtualClock())


def test_a_stranger_is_left_alone_and_a_stuck_bus_is_told() -> None:
    clock, bus = VirtualClock(), VirtualI2cBus()
    bus.attach(RealTimeClockChip())
    with pytest.raises(HardwareError, match="nobody answered"):
        Pca9685.probe(bus, (0x6F,), clock)
    bus.inject(BusFault.STUCK)
    with pytest.raises(HardwareError, match="the bus is stuck"):
        Pca9685.probe(bus, (0x6F,), clock)


def test_a_stranger_whose_registers_read_zero_is_left_alone_too() -> None:
    """A chip of this kind never tells a prescaler below 3, and a stranger may tell anything."""

    class Zeros(RealTimeClockChip):
        def read(self, register: int, count: int) -> bytes:
            return bytes(count)

    bus = VirtualI2cBus()
    bus.attach(Zeros())
    assert Pca9685.find(bus, 0x6F, VirtualClock()) is None


@pytest.mark.parametrize(
    ("register", "value", "told"),
    [
        (0x00, 0x30, "MODE1 = 0x20, got 0x30"),  # asleep
        (0x00, 0x21, "MODE1 = 0x20, got 0x21"),  # answers to 0x70 as well
        (0x01, 0x05, "MODE2 = 0x04, got 0x05"),  # what a stopped chip leaves its outputs at
        (0xFE, 0x1E, "PRE_SCALE = 0x03, got 0x1E"),
    ],
)
def test_any_other_mode_than_was_set_is_a_fault(register: int, value: int, told: str) -> None:
    clock, bus = VirtualClock(), VirtualI2cBus()
    bus.attach(Pca9685Registers(0x60, clock))
    chip = Pca9685(bus, 0x60, clock)
    chip.initialise()
    chip.check()
    if register == 0xFE:  # only while the oscillator sleeps
        bus.write(0x60, b"\x00\x30")
    bus.write(0x60, bytes((register, value)))
    if register == 0xFE:
        bus.write(0x60, b"\x00\x20")
    with pytest.raises(HardwareError, match=told):
        chip.check()


def test_initialise_silences_a_chip_left_running_and_sets_the_fastest_pwm() -> None:
    clock, bus = VirtualClock(), WatchedBus()
    registers = Pca9685Registers(0x6F, clock)
    bus.attach(registers)
    bus.write(0x6F, b"\x00\x21")
    clock.sleep(0.001)
    bus.write(0x6F, b"\x12\x00\x00\x00\x08")
    assert registers.outputs.any_high
    chip = Pca9685(bus, 0x6F, clock)
    bus.log.clear()
    chip.initialise()
    assert bus.log[0].data == b"\xfd\x10"
    assert bus.read(0x6F, 0xFE, 1) == b"\x03"
    assert not registers.outputs.any_high
    chip.set_channels(3, [0.5, 1.0])
    assert [duty(registers.outputs, c) for c in (3, 4, 5)] == [0.5, 1.0, 0.0]


def test_a_chip_is_off_until_any_output_is_set() -> None:
    clock, bus = VirtualClock(), VirtualI2cBus()
    bus.attach(Pca9685Registers(0x6F, clock))
    chip = Pca9685(bus, 0x6F, clock)
    chip.initialise()
    for channel, level in product(range(16), (0.01, 0.9)):
        chip.all_off()
        assert chip.is_off()
        chip.set_channels(channel, [level])
        assert not chip.is_off()


def test_an_output_of_a_chip_that_was_reset_is_told_as_that() -> None:
    clock, bus = VirtualClock(), VirtualI2cBus()
    registers = Pca9685Registers(0x6F, clock)
    bus.attach(registers)
    chip = Pca9685(bus, 0x6F, clock)
    chip.initialise()
    chip.set_channels(3, [0.5])
    chip.expect_channel(3, 0.5)
    registers.power_cycle()
    with pytest.raises(HardwareError, match="the chip was reset"):
        chip.expect_channel(3, 0.5)


@given(st.floats(0.0, 1.0))
def test_channel_bytes_give_the_duty_and_never_equal_counts(level: float) -> None:
    output = Output.from_registers(channel_bytes(level))
    high = sum(output.high(count) for count in range(4096))
    assert abs(high / 4096 - level) <= 0.5 / 4096 + 1e-12


def test_bus_times_are_those_of_nine_bits_per_byte() -> None:
    assert bus_time_s(41, 100_000) == pytest.approx(3.80e-3)
    assert bus_time_s(2, 100_000) == pytest.approx(0.29e-3)
    bus = WatchedBus(100_000)
    bus.attach(Pca9685Registers(0x6F, VirtualClock()))
    bus.write(0x6F, bytes(2))
    assert bus.busy_s == pytest.approx(0.29e-3)
    bus.read(0x6F, 0, 1)
    assert bus.busy_s == pytest.approx((0.29 + 0.39) * 1e-3)


class KernelBus:
    """Takes smbus2's own messages apart, as the kernel would."""

    devices = WatchedBus()

    def __init__(self, number: int) -> None:
        self.closed = False

    def i2c_rdwr(self, *messages: smbus2.i2c_msg) -> None:
        first = messages[0]
        assert not first.flags & I2C_M_RD
        if len(messages) == 1:
            self.devices.write(first.addr, bytes(first))
            return
        answer = messages[1]
        assert len(first) == 1
        assert (answer.addr, answer.flags & I2C_M_RD) == (first.addr, I2C_M_RD)
        data = self.devices.read(first.addr, bytes(first)[0], len(answer))
        for index, value in enumerate(data):
            answer.buf[index] = bytes((value,))

    def close(self) -> None:
        self.closed = True


def test_the_linux_bus_sends_and_receives_whole_messages(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(smbus2, "SMBus", KernelBus)
    clock, bus = VirtualClock(), SmbusBus(1)
    registers = Pca9685Registers(0x60, clock)
    KernelBus.devices.attach(registers)
    chip = Pca9685.probe(bus, (0x6F, 0x60), clock)
    chip.initialise()
    chip.set_channels(3, [1.0] * 10)
    assert len(KernelBus.devices.log[-1].data) == 41
    assert [duty(registers.outputs, channel) for channel in (2, 3, 12, 13)] == [0, 1, 1, 0]
    assert chip.bus.name == "/dev/i2c-1"
    bus.close()
    assert bus._bus.closed


def test_an_absent_bus_is_told_with_the_right_numbers() -> None:
    with pytest.raises(HardwareError, match="bus 1 on a Jetson Nano, bus 7 on an Orin Nano"):
        SmbusBus(250)


def test_an_update_of_both_motors_is_one_write_of_41_bytes() -> None:
    bus = WatchedBus()
    hat = VirtualHat(bus, MonotonicClock())
    chip = Pca9685.probe(bus, HatConfig().addresses, MonotonicClock())
    chip.initialise()
    written = len(bus.log)
    chip.set_channels(3, [0.0] * 10)
    assert [len(entry.data) for entry in [*bus.log][written:]] == [41]
    assert bus_time_s(41, 100_000) == pytest.approx(3.80e-3)
    assert bus_time_s(41, 400_000) == pytest.approx(0.95e-3)
    assert hat.wheel_angles_rad.tolist() == [0.0, 0.0]
