"""``RacingCars``: cars with speed dynamics, nine actions, on asphalt or on grass.

A point mass with a steered front axle: the engine pulls less the faster it goes, brakes and tyres
hold the car back, and tyres cannot turn it more sharply than their grip allows at its speed.
All in the metres of the real track; only what ``step`` returns is at the world's scale.
"""

from __future__ import annotations

import numpy as np

from robot.contract import ActionTable
from robot.geometry import wrap_angle
from robot.navigation.path import PathBatch
from sim_pybullet.delay_line import DelayLine
from sim_pybullet.look import DriveLook
from sim_pybullet.motors import PHYSICS_DT_S
from sim_pybullet.racing.track import SCALE
from sim_pybullet.vehicle import pursuit

# Steering (positive to the left) and throttle (negative brakes), in the order of paper B, section
# 3.1: straight, left, right, each with throttle, with brakes, and rolling.
RACING_ACTIONS: ActionTable = tuple(
    (float(steer), float(throttle)) for throttle in (1, -1, 0) for steer in (0, 1, -1)
)
FRAMES = 4  # that a racing policy sees (paper B, section 3.1)
TOP_SPEED_MPS = 25.0
ENGINE_MPS2 = 5.0  # at rest; nothing is left of it at top speed
BRAKE_MPS2 = 9.0
ROLLING_MPS2 = 0.6  # without throttle
GRASS_DRAG_PER_S = 0.5  # of the speed, on grass
GRIP_MPS2 = 9.0  # greatest sideways acceleration on asphalt
GRASS_GRIP_MPS2 = 4.0
SHARPEST_PER_M = 1.0 / 8.0  # curvature at full lock
# The expert:
_AHEAD_S, _AHEAD_M = 0.5, 4.0  # it steers for the point so far ahead
_BEND_M = 6.0  # stretch of road over which it measures a bend
_LOOKS_M = np.arange(0.0, 60.0, _BEND_M)
_CAREFUL = 0.6  # share of the grip it uses in bends


class RacingCars:
    """N cars; see `sim_pybullet.vehicle.Vehicle`.

    A ``DriveLook`` gives the engine's ``gain``, ``turn_gain`` of the steering, ``turn_lag_s``
    between wheel and tyre, ``delay_s`` between command and car, and ``noise`` of the speed.
    """

    actions = RACING_ACTIONS
    governed_mps = TOP_SPEED_MPS  # from where on the engine does not pull; set by the task

    def __init__(self, n_robots: int) -> None:
        self.on_grass = np.zeros(n_robots, dtype=bool)  # set by the task, which knows the track
        self.starts_mps = np.zeros(n_robots)  # speeds that episodes begin with; set by the task
        self.speed_mps = np.zeros(n_robots)
        self.steering = np.zeros(n_robots)  # in shares of full lock, positive to the left
        self._gain, self._turn_gain = np.ones(n_robots), np.ones(n_robots)
        self._follow, self._noise = np.ones(n_robots), np.zeros(n_robots)
        self._commands = DelayLine(n_robots, 2)
        self.counted = np.zeros((n_robots, 2))  # speed [m/s], turn rate [rad/s], world's scale
        self._table = np.array(RACING_ACTIONS)

    def reset(self, i: int, look: DriveLook) -> None:
        """Car ``i`` is on asphalt, its wheels straight, and drives at ``starts_mps``."""
        self.steering[i] = self.counted[i] = 0.0
        self.speed_mps[i] = self.starts_mps[i]
        self.on_grass[i] = False
        self._gain[i], self._turn_gain[i], self._noise[i] = look.gain, look.turn_gain, look.noise
        self._follow[i] = PHYSICS_DT_S / max(look.turn_lag_s, PHYSICS_DT_S)
        self._commands.reset(i, look.delay_s / PHYSICS_DT_S, np.zeros(2))

    def step(self, actions: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        """Advance by one physics step; (N, 2) forward speed and turn rate at the world's scale.

        Pairs are steering, positive to the left, and throttle.
        """
        self._commands.push(self._table[actions] if actions.ndim == 1 else actions)
        steer, throttle = self._commands.read().T
        self.steering += self._follow * (steer - self.steering)
        self.speed_mps = np.maximum(0.0, self.speed_mps + PHYSICS_DT_S * self._push(throttle))
        curvature = self.steering * np.minimum(SHARPEST_PER_M * self._turn_gain, self._sharpest())
        speed = self.speed_mps * (1.0 + self._noise * rng.standard_normal(len(self.speed_mps)))
        self.counted = np.stack((SCALE * speed, speed * curvature), axis=1)
        return self.counted

    def expert(self, paths: PathBatch, poses: np.ndarray, arc_m: np.ndarray) -> np.ndarray:
        """(N,) pursuit of the centre line, as fast as the bends ahead allow."""
        ahead_m = SCALE * (_AHEAD_M + _AHEAD_S * self.speed_mps)
        bend = SCALE * pursuit(paths, poses, arc_m + ahead_m)
        share = bend / np.minimum(SHARPEST_PER_M, self._sharpest())
        steer = np.round(np.clip(share, -1.0, 1.0)).astype(int)  # positive to the left
        headings = paths.headings_at(arc_m[:, None] + SCALE * np.append(_LOOKS_M, 60.0))
        bends = np.abs(np.asarray(wrap_angle(np.diff(headings, axis=1)))) / _BEND_M
        in_bend = _CAREFUL * GRIP_MPS2 / np.maximum(bends, 1e-6)  # squared speed
        allowed = np.sqrt(
            (in_bend + 1.2 * BRAKE_MPS2 * np.maximum(_LOOKS_M - 2.0, 0.0)).min(axis=1)
        )
        throttle = np.where(
            self.speed_mps > allowed, -1, (self.speed_mps < allowed - 1.0).astype(int)
        )
        return 3 * np.array([1, 2, 0])[throttle + 1] + np.array([2, 0, 1])[steer + 1]

    def _push(self, throttle: np.ndarray) -> np.ndarray:
        """(N,) acceleration along the car [m/s^2]."""
        engine = ENGINE_MPS2 * self._gain * (1.0 - self.speed_mps / TOP_SPEED_MPS)
        engine = np.where(self.speed_mps < self.governed_mps, engine, 0.0)
        push = np.where(throttle > 0.0, throttle * engine, throttle * BRAKE_MPS2)
        drag = ROLLING_MPS2 * (throttle <= 0.0) + GRASS_DRAG_PER_S * self.speed_mps * self.on_grass
        return np.asarray(push - drag)

    def _sharpest(self) -> np.ndarray:
        """(N,) curvature [1/m] that the tyres hold at this speed."""
        grip = np.where(self.on_grass, GRASS_GRIP_MPS2, GRIP_MPS2)
        return np.asarray(grip / np.maximum(self.speed_mps, 1.0) ** 2)
