"""The figures of one robot's motors and HAT; ``docs/wiring.md`` tells how to find them.

Positions go around a two-phase stepper's ring. At each of them IN1 and IN2 of a bridge say which
way the current of a winding flows and stay as they are; the duty is on the PWM input. Between the
pulses a TB6612FNG then shorts the winding (data sheet, H-SW control function: PWM low with one
input high), so that its current goes on and its mean is duty * V / R. With the duty on an input it
would die between the pulses: a twentieth is left at half duty. A winding without current has both
inputs low.
"""

import math
from dataclasses import dataclass
from typing import Dict, Literal, Tuple

from robot.contract import DRIVE
from robot.errors import ConfigError
from robot.geometry import DifferentialDrive
from robot.hat.bus import USUAL_ADDRESSES, bus_time_s

FULL_STEPS = 4  # of one electrical turn
MICROSTEPS = (1, 2, 4, 8, 16)  # into which a full step may be cut


def ring_levels(position: float, microsteps: int, duty: float) -> Tuple[float, ...]:
    """How much of the time each input is high, in the order of `PORTS`.

    The position is counted in microsteps (any number; the ring repeats). A full step forward turns
    the field from A (AIN2 high) to B (BIN1 high). Its angle advances evenly; the stronger winding
    always has the whole duty, which gives more torque than a sine curve: 1 is two-phase full
    stepping, 2 the usual half-step table. PWM inputs only differ from the duty between half steps,
    so that whole and half steps change nothing but directions.
    """
    turn = (position + (0.5 if microsteps == 1 else 0.0)) / (FULL_STEPS * microsteps)
    a, b = math.cos(2.0 * math.pi * turn), math.sin(2.0 * math.pi * turn)
    scale = duty / max(abs(a), abs(b))
    a, b = round(scale * a, 9), round(scale * b, 9)  # a winding without current has exactly 0
    on_a, on_b = float(a != 0.0), float(b != 0.0)
    forward_a, forward_b = float(a > 0.0), float(b > 0.0)
    inputs = (forward_a, on_a - forward_a, forward_b, on_b - forward_b)
    return (abs(a) or duty, *inputs, abs(b) or duty)


GAIN_MAX = 1.1
BUS_SHARE_MAX = 0.8  # of the bus's time that stepping may take


# PCA9685 channels of each pair of bridges (Adafruit 2348 and its 0x6F clones): PWMA, AIN2, AIN1,
# BIN1, BIN2, PWMB.
PORTS: Dict[str, Tuple[int, ...]] = {"M1M2": (8, 9, 10, 11, 12, 13), "M3M4": (2, 3, 4, 5, 6, 7)}

# What ends with a unit lies within; else it was given in another: cm, ms, kHz, degrees.
RANGES = {"hz": (1e4, 1e6), "m": (5e-3, 1.0), "mps": (1e-3, 10.0), "mps2": (1e-6, 100.0)}
RANGES.update(rev=(12.0, 2e4), s=(1e-6, 3600.0))


@dataclass(frozen=True)
class MotorConfig:
    """Where one motor is plugged in, and whether its positive direction drives backwards."""

    port: Literal["M1M2", "M3M4"]
    reversed: bool = False
    # How far this wheel really rolls in a step, as a share of what ``wheel_radius_m`` says: no two
    # are equal. ``duckpilot calibrate trim`` finds it.
    gain: float = 1.0

    def __post_init__(self) -> None:
        if not 1.0 / GAIN_MAX <= self.gain <= GAIN_MAX:
            raise ConfigError(
                f"motor gain: expected {1.0 / GAIN_MAX:.2f} to {GAIN_MAX:.2f}, got {self.gain:g}; "
                "a larger difference between two wheels is a fault to find"
            )


@dataclass(frozen=True)
class HatConfig:
    """All settings of the motor side; speeds are of the wheels' rims. ConfigError: out of range."""

    bus: int = 1  # pins 3 and 5: 1 on a Jetson Nano, 7 on an Orin Nano
    socket: str = ""  # of a virtual bus (duckpilot loop), instead of /dev/i2c-<bus>
    bus_hz: int = 100_000  # as the kernel sets it; a Nano's bus 1 runs at 100 kHz
    addresses: Tuple[int, ...] = USUAL_ADDRESSES  # tried in this order
    left: MotorConfig = MotorConfig("M1M2")
    right: MotorConfig = MotorConfig("M3M4", reversed=True)  # mounted as the left one's mirror
    drive: DifferentialDrive = DRIVE
    steps_per_rev: float = 48.0  # full steps per turn of the wheel: 7.5 degrees each
    microsteps: int = 2  # per full step
    run_duty: float = 1.0  # share of the supply voltage while stepping
    hold_duty: float = 0.3  # the same while standing
    acceleration_mps2: float = 0.8
    start_stop_mps: float = 0.05  # speed that the motor can start at, or stop from, without a ramp
    max_speed_mps: float = 0.4
    hold_after_s: float = 0.25  # standing time until the coils drop to hold_duty
    release_after_s: float = 60.0  # standing time until the coils are switched off
    command_timeout_s: float = 0.5  # a wheel speed older than this is taken as zero

    def __post_init__(self) -> None:
        _expect(self.bus >= 0, "bus", "the number of /dev/i2c-<bus>", self)
        # The six address pins span 0x40-0x7F; 0x70 is the all-call address, 0x78 on reserved.
        wrong = [f"0x{a:02X}" for a in self.addresses if not 0x40 <= a <= 0x77 or a == 0x70]
        if wrong or not self.addresses:
            raise ConfigError(
                "addresses: expected at least one address, each 0x40 to 0x77 but not 0x70, got "
                f"{', '.join(wrong) or 'none'}; the boards are sold as 0x6F or 0x60"
            )
        for part in (self, self.drive):
            for name, value in vars(part).items():
                if limits := RANGES.get(name.split("_")[-1]):
                    told = f"{limits[0]!r} to {limits[1]!r} in the unit that the name ends with"
                    _expect(limits[0] <= value <= limits[1], name, told, part)
        if self.microsteps not in MICROSTEPS:
            raise ConfigError(f"microsteps: expected one of {MICROSTEPS}, got {self.microsteps}")
        _expect(0.0 < self.run_duty <= 1.0, "run_duty", "0 < run_duty <= 1", self)
        _expect(0.0 <= self.hold_duty < self.run_duty, "hold_duty", "0 <= hold < run_duty", self)
        _expect(self.start_stop_mps <= self.max_speed_mps, "start_stop_mps", "<= maximum", self)
        _expect(self.hold_after_s <= self.release_after_s, "hold_after_s", "<= release", self)
        if self.left.port == self.right.port:
            raise ConfigError(f"right.port: expected another port than left's {self.left.port}")
        self._check_bus_share()

    def _check_bus_share(self) -> None:
        rate_hz = self.max_speed_mps / min(self.wheel_steps_m)
        step_s = bus_time_s(41, self.bus_hz)  # of both motors; see ``StepperHat``
        if self.microsteps > 2:
            step_s = bus_time_s(49, self.bus_hz) + bus_time_s(1 + 4, self.bus_hz, 2)
        carries_hz = BUS_SHARE_MAX / step_s
        if rate_hz > carries_hz:
            raise ConfigError(
                f"max_speed_mps {self.max_speed_mps:g} with microsteps {self.microsteps}: needs "
                f"{rate_hz:.0f} updates per second, a bus of {self.bus_hz // 1000} kHz carries "
                f"{carries_hz:.0f}; use fewer microsteps, a lower speed or a faster bus"
            )

    @property
    def step_m(self) -> float:
        """How far a rim moves in a microstep, the unit of all step counts, at gain 1 [m]."""
        steps_per_rev = self.steps_per_rev * self.microsteps
        return 2.0 * math.pi * self.drive.wheel_radius_m / steps_per_rev

    @property
    def wheel_steps_m(self) -> Tuple[float, float]:
        """The same of the left and of the right wheel, with their gains [m]."""
        return (self.step_m * self.left.gain, self.step_m * self.right.gain)


def _expect(holds: bool, name: str, expected: str, config: object) -> None:
    if not holds:
        raise ConfigError(f"{name}: expected {expected}, got {getattr(config, name)!r}")
