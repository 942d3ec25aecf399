"""From the rotors of a virtual HAT to the motion of a robot in a ``Town``."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from robot.computer.clock import Clock
from robot.contract import DRIVE
from sim_pybullet.look import DriveLook
from sim_pybullet.motors import MotorModel
from sim_pybullet.virtual.hat import VirtualHat

_NOMINAL = DriveLook()


class RolledWheels:
    """The mean rim speeds of both wheels between two calls, measured at the rotors."""

    def __init__(self, hat: VirtualHat, clock: Clock) -> None:
        self._hat = hat
        self._clock = clock
        self._time_s = clock.now()
        self._angles_rad = hat.wheel_angles_rad

    def since_last(self) -> np.ndarray:
        """(2,) left and right [m/s] since the last call; zero within an instant."""
        now_s, angles_rad = self._clock.now(), self._hat.wheel_angles_rad
        duration_s = now_s - self._time_s
        if duration_s <= 0.0:
            return np.zeros(2)
        rims_mps = (angles_rad - self._angles_rad) * DRIVE.wheel_radius_m / duration_s
        self._time_s, self._angles_rad = now_s, angles_rad
        return np.asarray(rims_mps)


class Tyres:
    """What the floor makes of rolling wheels, after a ``DriveLook``, by the motors of training.

    The motion of a `sim_pybullet.motors.MotorModel` whose commands are what the wheels rolled.
    Steps are exact, so a gain is a wheel of another radius, a trim two unequal ones, and a turn
    gain tyres that slip or an axle of another width. Ramps and rotors lag and shake by themselves,
    about as much as the nominal look says: only what a look has beyond that comes on top.
    """

    def __init__(self, look: DriveLook, dt_s: float) -> None:
        self._look, self._model = beyond_nominal(look), MotorModel(1, dt_s)
        self.stand()

    def stand(self) -> None:
        """Forget all motion: the robot stands."""
        self._model.reset(0, self._look)

    def twist(self, rims_mps: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        """(1, 2) forward speed [m/s] and turn rate [rad/s] of the next step."""
        return self._model.step(rims_mps[None], rng)


def beyond_nominal(look: DriveLook) -> DriveLook:
    """This look for wheels that have the nominal look's lags and noise already."""
    return replace(
        look,
        forward_lag_s=max(look.forward_lag_s - _NOMINAL.forward_lag_s, 0.0),
        turn_lag_s=max(look.turn_lag_s - _NOMINAL.turn_lag_s, 0.0),
        noise=math.sqrt(max(look.noise**2 - _NOMINAL.noise**2, 0.0)),
    )
