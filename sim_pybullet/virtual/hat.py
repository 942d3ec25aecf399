"""The HAT with two motors on it: register writes in, wheel angles out."""

from __future__ import annotations

import threading

import numpy as np

from robot.computer.clock import Clock
from sim_pybullet.virtual.i2c import VirtualI2cBus
from sim_pybullet.virtual.pca9685_registers import Pca9685Registers
from sim_pybullet.virtual.rotor import CoilDrive, Rotor, RotorModel, bridge_spans, coil_drive

# From the schematic of the Adafruit DC+Stepper Motor HAT (product 2348), which the 0x6F boards
# copy: terminal -> PCA9685 channels at the bridge's IN1, IN2 and PWM. Not the driver's table:
# exchanged pins must show.
M1 = (10, 9, 8)
M2 = (11, 12, 13)
M3 = (4, 3, 2)
M4 = (5, 6, 7)
LEFT, RIGHT = (M1, M2), (M3, M4)  # windings A and B of each motor, as docs/wiring.md has them
# The motors are mounted as mirror images: the right wheel rolls back when its rotor turns forward.
MOUNTING = (1.0, -1.0)


class VirtualHat:
    """A PCA9685, four bridges and two rotors on a bus.

    Motion is worked out up to the clock's present whenever the coils change or somebody asks for
    the wheels: in lock-step (``VirtualClock``), or beside a driver in another thread.
    """

    def __init__(
        self, bus: VirtualI2cBus, clock: Clock, address: int = 0x6F, model: RotorModel | None = None
    ) -> None:
        self._clock = clock
        self._time_s = clock.now()
        self._lock = threading.RLock()
        self.rotors = (Rotor(model or RotorModel()), Rotor(model or RotorModel()))
        self.chip = Pca9685Registers(address, clock, self._catch_up, self._drive_coils)
        bus.attach(self.chip)

    @property
    def wheel_angles_rad(self) -> np.ndarray:
        """(2,) how far the left and the right wheel have rolled forward by now [rad]."""
        self._catch_up()
        return np.array([s * r.angle_rad for s, r in zip(MOUNTING, self.rotors)])

    @property
    def lost_steps(self) -> tuple[int, int]:
        """Full steps that each rotor is behind (or ahead of) its field."""
        self._catch_up()
        return (self.rotors[0].lost_steps, self.rotors[1].lost_steps)

    @property
    def fields_rad(self) -> tuple[float | None, float | None]:
        """Electrical angle to which each motor's coils pull; None while they are off."""
        return (self.rotors[0].field_rad, self.rotors[1].field_rad)

    def _catch_up(self) -> None:
        with self._lock:
            now_s = self._clock.now()
            if now_s > self._time_s:
                for rotor in self.rotors:
                    rotor.advance(now_s - self._time_s)
                self._time_s = now_s

    def _drive_coils(self) -> None:
        with self._lock:
            for rotor, (wires_a, wires_b) in zip(self.rotors, (LEFT, RIGHT)):
                a, b = self._coil(wires_a, rotor), self._coil(wires_b, rotor)
                # Winding A is connected so that OUT2 high turns the rotor on to B.
                rotor.drive(CoilDrive(-a.current, a.closed), b)

    def _coil(self, wires: tuple[int, int, int], rotor: Rotor) -> CoilDrive:
        spans = bridge_spans(self.chip.outputs, *wires)
        return coil_drive(spans, self.chip.pwm_period_s, rotor.model.time_constant_s)
