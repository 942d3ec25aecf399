"""The HAT with two motors on it: register writes in, wheel angles out."""

from __future__ import annotations

import threading

import numpy as np

from robot.hat.clock import Clock
from robot.hat.config import PORTS, Port
from sim_pybullet.virtual.i2c import VirtualI2cBus
from sim_pybullet.virtual.pca9685_registers import Pca9685Registers
from sim_pybullet.virtual.rotor import Rotor, RotorModel
from sim_pybullet.virtual.tb6612 import bridge_drive

LEFT_PORT, RIGHT_PORT = PORTS["M1M2"], PORTS["M3M4"]
# The motors are mounted as mirror images: the right wheel rolls back when its rotor turns forward.
MOUNTING = (1.0, -1.0)


class VirtualHat:
    """A PCA9685, four bridges and two rotors on a bus.

    Motion follows the clock by itself: it is worked out up to the present whenever the coils change
    or somebody asks for the wheels. So it serves a lock-step simulation (``VirtualClock``) as well
    as a driver in another thread (``MonotonicClock``).
    """

    def __init__(
        self,
        bus: VirtualI2cBus,
        clock: Clock,
        address: int = 0x6F,
        model: RotorModel | None = None,
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
        return np.array([s * r.angle_rad for s, r in zip(MOUNTING, self.rotors)])  # noqa: B905

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
            self._drive_motor(LEFT_PORT, self.rotors[0])
            self._drive_motor(RIGHT_PORT, self.rotors[1])

    def _drive_motor(self, port: Port, rotor: Rotor) -> None:
        """Phase A is wound so that AIN2 high is positive: the ring turns the rotor forward."""
        a = bridge_drive(self.chip.outputs, port.ain1, port.ain2, port.pwma)
        b = bridge_drive(self.chip.outputs, port.bin1, port.bin2, port.pwmb)
        rotor.drive(-a.voltage, b.voltage, max(a.closed, b.closed))
