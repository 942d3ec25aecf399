"""A two-phase stepper with its load, and its windings behind TB6612FNG bridges.

A winding is an inductance and a resistance; currents are in units of supply voltage / resistance. A
bridge that drives pulls the current towards +1 or -1, one that brakes lets it decay towards 0, both
with the time constant L / R. With the outputs at high impedance what is left flows through the body
diodes against the supply, as if the voltage were reversed, until it is gone; then nothing flows
(drops of the diodes left out).

Torque is holding torque times the sine of the angle between field and rotor (Acarnley, Stepping
Motors, 4th ed., chapter 3); a field that moves too fast, or against too much load, leaves the rotor
behind by whole electrical turns of four full steps, and that is counted.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import Enum
from functools import lru_cache
from typing import NamedTuple

from sim_pybullet.virtual.pca9685_registers import PwmOutputs


class BridgeState(Enum):
    """What the outputs of a bridge do."""

    CW = "OUT1 high, OUT2 low"
    CCW = "OUT1 low, OUT2 high"
    SHORT_BRAKE = "both low: the winding is shorted, its current goes round and decays slowly"
    STOP = "high impedance: the current flows back into the supply and is gone soon"


PULL = {BridgeState.CW: 1.0, BridgeState.CCW: -1.0, BridgeState.SHORT_BRAKE: 0.0}
PERIODS = 400  # until a period repeats itself; a time constant is a handful of periods at most
REPEATS = 1e-9


class Span(NamedTuple):
    """A part of the PWM period in which the outputs do not change."""

    share: float
    state: BridgeState


class CoilDrive(NamedTuple):
    """What a bridge does to its winding, averaged over a PWM period."""

    current: float  # mean, once it repeats itself; positive for CW
    closed: float  # share of the period in which the winding is not at high impedance


RELEASED = CoilDrive(0.0, 0.0)


def bridge_state(in1: bool, in2: bool, pwm: bool) -> BridgeState:
    """What the levels at its inputs make of a bridge, with STBY high as on the boards.

    "H-SW Control Function" of Toshiba's data sheet, which lists two low inputs with PWM high only;
    no transistor conducts.
    """
    if in1 == in2:
        return BridgeState.SHORT_BRAKE if in1 else BridgeState.STOP
    return BridgeState.SHORT_BRAKE if not pwm else BridgeState.CW if in1 else BridgeState.CCW


def bridge_spans(outputs: PwmOutputs, in1: int, in2: int, pwm: int) -> tuple[Span, ...]:
    """The PWM period, from the PCA9685 channels wired to IN1, IN2 and PWM."""
    spans = outputs.spans(in1, in2, pwm)
    return tuple(Span(share, bridge_state(*levels)) for share, levels in spans)


@lru_cache(maxsize=4096)
def coil_drive(spans: tuple[Span, ...], period_s: float, time_constant_s: float) -> CoilDrive:
    """What a winding of this L / R [s] makes of the states within a PWM period of ``period_s``."""
    closed = sum(span.share for span in spans if span.state is not BridgeState.STOP)
    if closed == 0.0:
        return RELEASED
    if all(span.state is not BridgeState.STOP for span in spans):
        # Linear, so that the mean current is what the mean voltage would drive.
        return CoilDrive(sum(span.share * PULL[span.state] for span in spans), 1.0)
    current = mean = 0.0
    for _ in range(PERIODS):
        before, charge = current, 0.0
        for span in spans:
            current, part = _follow(current, span.state, span.share * period_s, time_constant_s)
            charge += part
        mean = charge / period_s
        if abs(current - before) < REPEATS:
            break
    return CoilDrive(mean, closed)


def relax(current: float, drive: CoilDrive, keep: float) -> float:
    """The current after a time in which a share of ``keep`` = exp(-time / (L / R)) is left."""
    if drive.closed > 0.0:
        return drive.current + (current - drive.current) * keep
    if current > 0.0:
        return max((current + 1.0) * keep - 1.0, 0.0)
    return min((current - 1.0) * keep + 1.0, 0.0)


def _follow(
    current: float, state: BridgeState, duration_s: float, time_constant_s: float
) -> tuple[float, float]:
    """Current at the end of a span, and the integral of it over the span [s]."""
    if state is BridgeState.STOP:
        empty_s = time_constant_s * math.log1p(abs(current))
        pull = -math.copysign(1.0, current)
        flows_s = min(duration_s, empty_s)
    else:
        pull, flows_s, empty_s = PULL[state], duration_s, math.inf
    keep = math.exp(-flows_s / time_constant_s)
    charge = pull * flows_s + (current - pull) * time_constant_s * (1.0 - keep)
    return (pull + (current - pull) * keep if empty_s > duration_s else 0.0), charge


FULL_STEPS = 4  # of one electrical turn


@dataclass(frozen=True)
class RotorModel:
    """A 7.5 degree motor of the 35 mm class on a wheel that carries half of a 0.6 kg robot."""

    steps_per_rev: float = 48.0
    holding_torque_nm: float = 0.05  # at full voltage, two coils carry 1.41 times as much
    inertia_kgm2: float = 3.2e-4  # 0.3 kg at the rim of a 32.5 mm wheel; the rotor's is 1e-6
    damping_nms: float = 5e-4  # back EMF into the supply: (torque constant)^2 / resistance
    friction_nm: float = 0.005  # rolling and bearings
    time_constant_s: float = 1e-3  # L / R of a winding: 0.3 to 3 ms in motors of this class

    @property
    def electrical_turns(self) -> float:
        """Electrical turns per turn of the wheel."""
        return self.steps_per_rev / FULL_STEPS


class Rotor:
    """Angle and speed of one rotor, integrated by semi-implicit Euler steps of at most 0.2 ms."""

    STEP_S = 2e-4

    def __init__(self, model: RotorModel, angle_rad: float = 0.0) -> None:
        self.model = model
        self.angle_rad = angle_rad  # of the wheel
        self.speed_radps = 0.0
        self.load_nm = 0.0  # positive pushes towards positive angles
        self.currents = (0.0, 0.0)  # now [supply voltage / resistance]
        self.drives = (RELEASED, RELEASED)  # where the currents settle
        self.field_rad: float | None = None  # electrical, where it wants the rotor; None: coils off

    @property
    def lost_steps(self) -> int:
        """Full steps between field and rotor now, a multiple of 4; 0 while the coils are off."""
        if self.field_rad is None:
            return 0
        behind = self.field_rad - self.model.electrical_turns * self.angle_rad
        return FULL_STEPS * round(behind / (2.0 * math.pi))

    def drive(self, phase_a: CoilDrive, phase_b: CoilDrive) -> None:
        """Set what the bridges do from now on; the currents follow by L / R."""
        self.drives = (phase_a, phase_b)
        if phase_a.current == 0.0 and phase_b.current == 0.0:
            self.field_rad = None
            return
        angle_rad = math.atan2(phase_b.current, phase_a.current)
        reference = self.field_rad
        if reference is None:  # switched on: the rotor goes to the nearest equilibrium
            reference = self.model.electrical_turns * self.angle_rad
        self.field_rad = reference + math.remainder(angle_rad - reference, 2.0 * math.pi)

    def advance(self, duration_s: float) -> None:
        """Integrate over ``duration_s`` [s] with the coils as they are."""
        count = max(1, math.ceil(duration_s / self.STEP_S))
        dt_s = duration_s / count
        model, turns = self.model, self.model.electrical_turns
        drive_a, drive_b = self.drives
        current_a, current_b = self.currents
        keep = math.exp(-dt_s / model.time_constant_s)
        damping = model.damping_nms * max(drive_a.closed, drive_b.closed)
        friction = model.friction_nm * dt_s / model.inertia_kgm2
        angle, speed = self.angle_rad, self.speed_radps
        for _ in range(count):
            current_a = relax(current_a, drive_a, keep)
            current_b = relax(current_b, drive_b, keep)
            electrical = turns * angle
            pull = current_b * math.cos(electrical) - current_a * math.sin(electrical)
            torque = model.holding_torque_nm * pull + self.load_nm
            speed += dt_s * (torque - damping * speed) / model.inertia_kgm2
            speed = math.copysign(max(abs(speed) - friction, 0.0), speed)
            angle += dt_s * speed
        self.angle_rad, self.speed_radps = angle, speed
        self.currents = (current_a, current_b)
