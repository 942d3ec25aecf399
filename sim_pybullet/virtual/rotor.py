"""A two-phase stepper with its load: where the rotor goes when its windings are driven.

Torque is holding torque times the sine of the angle between field and rotor (Acarnley, Stepping
Motors, 4th ed., chapter 3); a field that moves too fast, or against too much load, leaves the rotor
behind by whole electrical turns of four full steps, and that is counted.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from sim_pybullet.virtual.coil import RELEASED, CoilDrive, relax

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
        self._drives = (RELEASED, RELEASED)
        self.field_rad: float | None = None  # electrical, where it wants the rotor; None: coils off

    @property
    def lost_steps(self) -> int:
        """Full steps between field and rotor now, a multiple of 4; 0 while the coils are off."""
        if self.field_rad is None:
            return 0
        behind = self.field_rad - self.model.electrical_turns * self.angle_rad
        return FULL_STEPS * round(behind / (2.0 * math.pi))

    @property
    def mean_currents(self) -> tuple[float, float]:
        """Where the currents settle, averaged over the PWM [supply voltage / resistance]."""
        return (self._drives[0].current, self._drives[1].current)

    def drive(self, phase_a: CoilDrive, phase_b: CoilDrive) -> None:
        """Set what the bridges do from now on; the currents follow by L / R."""
        self._drives = (phase_a, phase_b)
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
        drive_a, drive_b = self._drives
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
