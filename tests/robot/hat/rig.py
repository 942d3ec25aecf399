"""A driver on virtual hardware in lock-step: the bench on which the motor side is tested."""

from __future__ import annotations

import math
from collections import deque
from typing import Deque, List, NamedTuple, Optional

from robot.computer.clock import Clock
from robot.geometry import WheelSpeeds
from robot.hat.config import HatConfig
from robot.hat.driver import MotorDriver
from robot.hat.stepper_hat import StepperHat
from robot.hat.stepping import StepPlanner
from sim_pybullet.virtual.clock import VirtualClock, run_until
from sim_pybullet.virtual.hat import VirtualHat
from sim_pybullet.virtual.i2c import VirtualI2cBus
from sim_pybullet.virtual.pca9685_registers import PwmOutputs
from sim_pybullet.virtual.rotor import RotorModel

ALL_OFF = b"\xfd\x10"
REFRESH_S = 0.1  # as often as a policy decides


class Transaction(NamedTuple):
    """What went over the wire; ``data`` without the address byte."""

    address: int
    data: bytes
    read_count: int


class WatchedBus(VirtualI2cBus):
    """A bus that notes what goes over it, and takes its time by a clock, if there is one."""

    def __init__(self, bus_hz: int = 100_000, clock: Optional[Clock] = None) -> None:
        super().__init__()
        self.log: Deque[Transaction] = deque(maxlen=4096)
        self.busy_s = 0.0
        self._bus_hz, self._clock = bus_hz, clock

    def write(self, address: int, data: bytes) -> None:
        self._begin(Transaction(address, bytes(data), 0))
        super().write(address, data)

    def read(self, address: int, register: int, count: int) -> bytes:
        self._begin(Transaction(address, bytes((register,)), count))
        return super().read(address, register, count)

    def _begin(self, transaction: Transaction) -> None:
        self.log.append(transaction)
        messages = 2 if transaction.read_count else 1
        size = messages + len(transaction.data) + transaction.read_count
        duration_s = (9 * size + messages + 1) / self._bus_hz
        self.busy_s += duration_s
        if self._clock is not None:
            self._clock.sleep(duration_s)


class Rig(NamedTuple):
    clock: VirtualClock
    bus: WatchedBus
    hat: VirtualHat
    driver: MotorDriver

    def drive(self, left_mps: float, right_mps: float, duration_s: float) -> None:
        """Command these speeds, refreshed as the runtime does, for a time."""
        end_s = self.clock.now() + duration_s
        while self.clock.now() < end_s - 1e-9:
            self.driver.set_wheels(WheelSpeeds(left_mps, right_mps))
            run_until(self.driver, self.clock, min(end_s, self.clock.now() + REFRESH_S))

    def wait(self, duration_s: float) -> None:
        """Command nothing for a time."""
        run_until(self.driver, self.clock, self.clock.now() + duration_s)

    def come_to_rest(self) -> None:
        """Ramp down and let the rotors settle."""
        self.drive(0.0, 0.0, 2.0)

    @property
    def rolled_m(self) -> List[float]:
        """How far each wheel has rolled."""
        radius_m = self.driver.config.drive.wheel_radius_m
        return [float(angle) * radius_m for angle in self.hat.wheel_angles_rad]

    @property
    def last(self) -> Transaction:
        """The last transaction on the bus."""
        return self.bus.log[-1]


def make_rig(config: Optional[HatConfig] = None, model: Optional[RotorModel] = None) -> Rig:
    """A rig whose driver is not yet open; the bus takes its time, as a real one does."""
    config = config or HatConfig()
    clock = VirtualClock()
    bus = WatchedBus(config.bus_hz, clock)
    model = model or RotorModel(steps_per_rev=config.steps_per_rev)
    hat = VirtualHat(bus, clock, model=model)
    return Rig(clock, bus, hat, MotorDriver(StepperHat(bus, config, clock), config, clock))


def speeds(planner: StepPlanner, time_s: float) -> WheelSpeeds:
    """The speeds that the ramps have reached [m/s]."""
    steps_m = planner._config.wheel_steps_m
    left, right = (w.at(time_s)[1] * step_m for w, step_m in zip(planner._wheels, steps_m))
    return WheelSpeeds(left, right)


def duty(outputs: PwmOutputs, channel: int) -> float:
    """Share of the period that a pin is high."""
    return outputs.channels[channel].length / 4096


def full_step_m(config: HatConfig) -> float:
    """How far the rim moves in a full step [m]."""
    return 2.0 * math.pi * config.drive.wheel_radius_m / config.steps_per_rev


def turns_apart(a_rad: float, b_rad: float) -> float:
    """Distance of two angles around the circle [rad]."""
    return abs(math.remainder(a_rad - b_rad, 2.0 * math.pi))
