"""Random legal traffic: the byte-level chip against a register file of a few lines."""

from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, invariant, rule

from sim_pybullet.virtual.clock import VirtualClock
from sim_pybullet.virtual.i2c import VirtualI2cBus
from sim_pybullet.virtual.pca9685_registers import Pca9685Registers
from tests.robot.hat.rig import duty

channels = st.integers(0, 15)
levels = st.lists(st.integers(0, 4096), min_size=1, max_size=16)


def encode(level: int) -> bytes:
    if level == 0:
        return bytes((0, 0, 0, 0x10))
    if level == 4096:
        return bytes((0, 0x10, 0, 0))
    return bytes((0, 0, level & 0xFF, level >> 8))


class LegalTraffic(RuleBasedStateMachine):
    def __init__(self) -> None:
        super().__init__()
        self.clock = VirtualClock()
        self.bus = VirtualI2cBus()
        self.chip = Pca9685Registers(0x6F, self.clock)
        self.bus.attach(self.chip)
        self.levels = [0] * 16
        self.awake = False
        self.pre_scale = 0x1E
        self.write(0x00, 0x30)

    def write(self, register: int, *data: int) -> None:
        self.bus.write(0x6F, bytes((register, *data)))

    @rule(first=channels, values=levels)
    def set_channels(self, first: int, values: list) -> None:
        values = values[: 16 - first]
        self.write(0x06 + 4 * first, *b"".join(map(encode, values)))
        self.levels[first : first + len(values)] = values

    @rule(value=st.integers(0, 4096))
    def set_all(self, value: int) -> None:
        self.write(0xFA, *encode(value))
        self.levels = [value] * 16

    @rule()
    def all_off(self) -> None:
        self.write(0xFD, 0x10)
        self.levels = [0] * 16

    @rule(value=st.integers(0, 255))
    def set_pre_scale(self, value: int) -> None:
        self.write(0xFE, value)
        if not self.awake:
            self.pre_scale = max(3, value)

    @rule()
    def sleep(self) -> None:
        self.all_off()
        self.write(0x00, 0x30)
        self.clock.sleep(0.1)
        self.awake = False

    @rule()
    def wake(self) -> None:
        self.write(0x00, 0x20)
        self.clock.sleep(500e-6)
        self.awake = True

    @rule()
    def reset(self) -> None:
        self.chip.power_cycle()
        self.levels, self.awake, self.pre_scale = [0] * 16, False, 0x1E
        self.write(0x00, 0x30)

    @invariant()
    def registers_agree(self) -> None:
        # After all_off the counts stay behind the full-OFF bit, so only that bit is compared.
        led = self.bus.read(0x6F, 0x06, 64)
        for channel, level in enumerate(self.levels):
            registers = led[4 * channel : 4 * channel + 4]
            assert registers == encode(level) or (level == 0 and registers[3] & 0x10)
        assert self.bus.read(0x6F, 0xFE, 1)[0] == self.pre_scale

    @invariant()
    def outputs_agree(self) -> None:
        expected = [level / 4096 if self.awake else 0.0 for level in self.levels]
        assert [duty(self.chip.outputs, channel) for channel in range(16)] == expected


LegalTraffic.TestCase.settings = settings(max_examples=40, stateful_step_count=25, deadline=None)
TestLegalTraffic = LegalTraffic.TestCase
