"""From the rotors of a virtual HAT to the motion of a robot in a ``Town``."""

from __future__ import annotations

import numpy as np

from robot.contract import DRIVE
from robot.geometry import DifferentialDrive, Twist, WheelSpeeds
from robot.hat.clock import Clock
from sim_pybullet.virtual.hat import VirtualHat


class RolledTwist:
    """What ``Town.step`` needs, measured at the wheels: the mean motion between two calls."""

    def __init__(self, hat: VirtualHat, clock: Clock, drive: DifferentialDrive = DRIVE) -> None:
        self._hat = hat
        self._clock = clock
        self._drive = drive
        self._time_s = clock.now()
        self._angles_rad = hat.wheel_angles_rad

    def since_last(self) -> Twist:
        """Forward speed [m/s] and turn rate [rad/s] since the last call; zero within an instant."""
        now_s, angles_rad = self._clock.now(), self._hat.wheel_angles_rad
        duration_s = now_s - self._time_s
        if duration_s <= 0.0:
            return Twist(0.0, 0.0)
        rims_mps = (angles_rad - self._angles_rad) * self._drive.wheel_radius_m / duration_s
        self._time_s, self._angles_rad = now_s, angles_rad
        return self._drive.twist(WheelSpeeds(*np.asarray(rims_mps, dtype=float).tolist()))
