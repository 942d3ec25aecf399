"""Each law of the data sheet that a driver could trip over, one by one."""

import errno
from collections.abc import Callable

import pytest

from sim_pybullet.virtual.clock import VirtualClock
from sim_pybullet.virtual.i2c import VirtualI2cBus
from sim_pybullet.virtual.pca9685_registers import ChipMisuseError, Pca9685Registers

ADDRESS = 0x6F
FULL_ON, FULL_OFF = bytes((0, 0x10, 0, 0)), bytes((0, 0, 0, 0x10))


class Bench:
    """A chip on a bus, with shorthands."""

    def __init__(self) -> None:
        self.clock = VirtualClock()
        self.bus = VirtualI2cBus()
        self.chip = Pca9685Registers(ADDRESS, self.clock)
        self.bus.attach(self.chip)

    def write(self, register: int, *data: int) -> None:
        self.bus.write(ADDRESS, bytes((register, *data)))

    def read(self, register: int, count: int = 1) -> bytes:
        return self.bus.read(ADDRESS, register, count)

    def wake(self, mode1: int = 0x21) -> None:
        self.write(0x00, mode1)
        self.clock.sleep(500e-6)

    def duty(self, channel: int) -> float:
        return self.chip.outputs.channels[channel].length / 4096


@pytest.fixture
def bench() -> Bench:
    return Bench()


def refused(call: Callable[..., object], *arguments: object, **options: object) -> int:
    """The errno that the bus answers with."""
    with pytest.raises(OSError, match=r"\[Errno \d+\]") as caught:
        call(*arguments, **options)
    return caught.value.errno or 0


def test_power_on_values(bench: Bench) -> None:
    assert [bench.read(r)[0] for r in range(6)] == [0x11, 0x04, 0xE2, 0xE4, 0xE8, 0xE0]
    assert [bench.read(0x06 + i)[0] for i in range(4)] == [0, 0, 0, 0x10]
    assert bench.read(0xFE) == b"\x1e"
    assert not bench.chip.outputs.any_high


def test_nobody_at_another_address_and_no_empty_message(bench: Bench) -> None:
    assert refused(bench.bus.write, 0x60, b"\x00") == errno.EREMOTEIO == 121
    assert refused(bench.bus.read, 0x60, 0, 1) == 121
    assert refused(bench.bus.write, ADDRESS, b"") == errno.EOPNOTSUPP
    assert refused(bench.bus.read, ADDRESS, 0, 0) == errno.EOPNOTSUPP


def test_without_auto_increment_every_byte_goes_to_one_register(bench: Bench) -> None:
    bench.write(0x06, 0x01, 0x02, 0x03)
    assert bench.read(0x06) == b"\x03"
    assert bench.read(0x07) == b"\x00"
    assert bench.read(0x06, 3) == b"\x03\x03\x03"


def test_auto_increment_rolls_over_after_the_last_channel_and_after_pre_scale(
    bench: Bench,
) -> None:
    bench.wake()
    bench.write(0x42, 0, 0, 0, 0x08, 0x20, 0x05)
    assert bench.read(0x42, 6) == bytes((0, 0, 0, 0x08, 0x20, 0x05))
    assert bench.read(0xFA, 7) == bytes((0, 0, 0, 0, 0x1E, 0x20, 0x05))


def test_one_message_of_forty_bytes_sets_ten_channels(bench: Bench) -> None:
    bench.wake()
    bench.write(0x12, *(FULL_ON * 10))
    assert [bench.duty(c) for c in range(16)] == [0.0] * 3 + [1.0] * 10 + [0.0] * 3


def test_pre_scale_is_locked_while_awake_and_never_below_three(bench: Bench) -> None:
    bench.write(0xFE, 1)
    assert bench.read(0xFE) == b"\x03"
    bench.wake()
    bench.write(0xFE, 100)
    assert bench.read(0xFE) == b"\x03"


def test_read_only_bits_read_zero(bench: Bench) -> None:
    bench.write(0x01, 0xE4)
    assert bench.read(0x01) == b"\x04"
    bench.write(0x00, 0x31)
    bench.write(0x06, 1, 0xFF, 2, 0xEF)
    assert bench.read(0x06, 4) == bytes((1, 0x1F, 2, 0x0F))


@pytest.mark.parametrize("register", [0x46, 0x80, 0xF9])
def test_reserved_registers_are_not_acknowledged(bench: Bench, register: int) -> None:
    assert refused(bench.write, register, 0) == 121
    assert refused(bench.read, register) == 121


def test_test_mode_is_refused(bench: Bench) -> None:
    with pytest.raises(ChipMisuseError, match="0xFF"):
        bench.write(0xFF, 1)


def test_full_off_wins_over_full_on(bench: Bench) -> None:
    bench.wake()
    bench.write(0x06, 0, 0x10, 0, 0x10)
    assert bench.duty(0) == 0.0
    bench.write(0x09, 0)
    assert bench.duty(0) == 1.0


@pytest.mark.parametrize(
    ("on", "off", "duty"),
    [(0, 1024, 0.25), (1024, 0, 0.75), (4095, 1, 2 / 4096), (1, 4095, 4094 / 4096)],
)
def test_duty_counts_from_on_to_off_around_the_period(
    bench: Bench, on: int, off: int, duty: float
) -> None:
    bench.wake()
    bench.write(0x0A, on & 0xFF, on >> 8, off & 0xFF, off >> 8)
    assert bench.duty(1) == pytest.approx(duty)


def test_equal_counts_are_a_mistake(bench: Bench) -> None:
    bench.wake()
    with pytest.raises(ChipMisuseError, match="both 7"):
        bench.write(0x06, 7, 0, 7, 0)


def test_all_led_writes_every_channel_and_reads_zero(bench: Bench) -> None:
    bench.wake()
    bench.write(0xFA, 0, 0, 0, 0x08)
    assert [bench.duty(c) for c in range(16)] == [0.5] * 16
    assert bench.read(0xFA, 4) == bytes(4)
    bench.write(0xFD, 0x10)
    assert not bench.chip.outputs.any_high


def test_a_channel_that_a_cut_off_write_left_with_equal_counts_is_low_for_once(
    bench: Bench,
) -> None:
    bench.wake()
    bench.write(0x06, *FULL_ON)
    bench.write(0x06, 0, 0)
    assert bench.duty(0) == 0.0
    with pytest.raises(ChipMisuseError, match="both 0"):
        bench.write(0x0A, *FULL_ON)


def test_open_drain_cannot_drive_the_bridges(bench: Bench) -> None:
    bench.wake()
    bench.write(0x01, 0x00)
    with pytest.raises(ChipMisuseError, match="OUTDRV"):
        bench.write(0x06, *FULL_ON)


def test_outputs_are_low_while_asleep_and_come_back(bench: Bench) -> None:
    bench.wake()
    bench.write(0x06, *FULL_ON)
    bench.write(0x00, 0x31)
    assert (bench.duty(0), bench.read(0x00)) == (0.0, b"\x31")
    bench.wake()
    assert (bench.duty(0), bench.read(0x00)) == (1.0, b"\x21")


def test_what_the_model_leaves_out_is_told(bench: Bench) -> None:
    for mode1 in (0x80, 0x40, 0x08, 0x04, 0x02):  # RESTART, EXTCLK, three more addresses
        with pytest.raises(ChipMisuseError, match="MODE1"):
            bench.write(0x00, mode1)
    for register, value in ((0x01, 0x10), (0x01, 0x08), (0x02, 0xE2), (0x05, 0xE0)):
        with pytest.raises(ChipMisuseError, match="not modelled"):
            bench.write(register, value)
    bench.wake()
    bench.write(0x06, 0, 0, 0, 0x08)
    with pytest.raises(ChipMisuseError, match="RESTART"):
        bench.write(0x00, 0x31)


def test_impatience_after_waking_is_a_mistake(bench: Bench) -> None:
    bench.write(0x00, 0x21)
    bench.clock.sleep(499e-6)
    with pytest.raises(ChipMisuseError, match="500 us"):
        bench.write(0x06, *FULL_ON)
