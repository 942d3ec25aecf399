"""What carries out actions: ``MotorModel``, how fast robots move after wheel speeds were commanded.

After a delay and the motor driver's ramp, forward speed and turn rate follow the command with
first-order lags of their own; gain, trim and noise of the wheels come on top. But for these it is
gym-duckietown's model of the DB18 (u' = -5u + 1.5(R + L), w' = -4w + 15(R - L), 1/30 s a step).
"""

import math

import numpy as np

from robot.contract import (
    ACTION_TWISTS,
    CONTROL_DT_S,
    DRIVE,
    FIVE_ACTIONS,
    MAX_WHEEL_MPS,
    ActionTable,
)
from robot.navigation.path import PathBatch
from sim_pybullet.look import DriveLook


class DelayLine:
    """Rows of ``width`` numbers; each robot has a delay of its own, read linearly between steps."""

    def __init__(self, n_robots: int, width: int) -> None:
        self._values = np.zeros((2, n_robots, width))  # a ring that holds the longest delay
        self._whole = np.zeros(n_robots, dtype=int)  # delay = whole + share steps
        self._share = np.zeros((n_robots, 1))
        self._robots = np.arange(n_robots)
        self._now = 0

    def reset(self, i: int, delay_steps: float, value: np.ndarray) -> None:
        """From now on robot ``i`` has this delay; all it can still read are ``value`` (W,)."""
        self._whole[i] = math.floor(delay_steps)
        self._share[i] = delay_steps - self._whole[i]
        missing = int(self._whole[i]) + 2 - len(self._values)
        if missing > 0:
            oldest_first = np.roll(self._values, -self._now - 1, axis=0)
            self._values = np.pad(oldest_first, ((missing, 0), (0, 0), (0, 0)))
            self._now = len(self._values) - 1
        self._values[:, i] = value

    def push(self, values: np.ndarray) -> None:
        """Write the values (N, W) of the next step."""
        self._now = (self._now + 1) % len(self._values)
        self._values[self._now] = values

    def read(self) -> np.ndarray:
        """The values (N, W) that come out of the line at this step."""
        depth = len(self._values)
        newer = self._values[(self._now - self._whole) % depth, self._robots]
        if not self._share.any():
            return np.asarray(newer)
        older = self._values[(self._now - self._whole - 1) % depth, self._robots]
        return np.asarray((1.0 - self._share) * newer + self._share * older)


PHYSICS_STEPS = 3  # per decision
PHYSICS_DT_S = CONTROL_DT_S / PHYSICS_STEPS


class MotorModel:
    """The motors of N robots, each after a ``DriveLook`` of its own.

    A command that reaches the wheels within a step of ``dt_s`` counts for the rest of that step; a
    lag shorter than a step is none. ``twists`` (N, 2) are forward speed [m/s] and turn rate
    [rad/s]; ``counted`` likewise by the steps made, as odometry knows them: without gain, trim,
    noise and slip.
    """

    def __init__(self, n_robots: int, dt_s: float = PHYSICS_DT_S) -> None:
        self._dt_s = dt_s
        self._decay = np.zeros((n_robots, 2))  # of forward speed and turn rate, per step
        self._gains = np.ones((n_robots, 2))  # left, right
        self._turn_gain, self._noise = np.ones(n_robots), np.zeros(n_robots)
        self.twists, self.counted = np.zeros((n_robots, 2)), np.zeros((n_robots, 2))
        self._commands, self._ramped = DelayLine(n_robots, 2), np.zeros((n_robots, 2))
        self._most_mps = np.zeros((n_robots, 1))  # that a rim gains in a step
        for i in range(n_robots):
            self.reset(i, DriveLook())

    def reset(self, i: int, look: DriveLook) -> None:
        """Robot ``i`` stands still, with no command under way, and drives after ``look``."""
        lags_s = (look.forward_lag_s, look.turn_lag_s)
        self._decay[i] = [1.0 - self._dt_s / max(lag, self._dt_s) for lag in lags_s]
        self._gains[i] = look.gain - look.trim, look.gain + look.trim
        self._turn_gain[i], self._noise[i] = look.turn_gain, look.noise
        self._commands.reset(i, look.delay_s / self._dt_s, np.zeros(2))
        self._most_mps[i], self._ramped[i] = look.acceleration_mps2 * self._dt_s, 0.0
        self.twists[i] = self.counted[i] = 0.0

    def step(self, actions: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        """The ``twists`` after one more step at commanded rim speeds (N, 2), left and right."""
        self._commands.push(actions)
        before, most = self._ramped, self._most_mps
        self._ramped = np.clip(self._commands.read(), before - most, before + most)
        wheels = self._ramped * self._gains
        if self._noise.any():
            wheels *= 1.0 + self._noise[:, None] * rng.standard_normal(wheels.shape)
        target = _twists(wheels)
        target[:, 1] *= self._turn_gain
        self.twists = target + (self.twists - target) * self._decay
        target = _twists(self._ramped)
        self.counted = target + (self.counted - target) * self._decay
        return self.twists.copy()


def _twists(wheel_mps: np.ndarray) -> np.ndarray:
    """(N, 2) forward speed and turn rate of left and right wheel speeds (N, 2)."""
    left, right = wheel_mps.T
    return np.stack((0.5 * (left + right), (right - left) / DRIVE.baseline_m), axis=1)


EXPERT_AHEAD_M = 0.14  # along its path, where the expert heads for
_CURVATURES = np.array([twist.turn_radps / twist.forward_mps for twist in ACTION_TWISTS])  # [1/m]


def expert_actions(
    paths: PathBatch, poses: np.ndarray, arc_m: np.ndarray, ahead_m: float = EXPERT_AHEAD_M
) -> np.ndarray:
    """The actions (N,) of experts at true poses (N, 3): whose circle is nearest to `pursuit`'s."""
    curvature = pursuit(paths, poses, np.asarray(arc_m) + ahead_m)
    return np.abs(curvature[:, None] - _CURVATURES).argmin(axis=1)


class WheeledRobots(MotorModel):
    """The project's robots, whose actions are pairs of wheel speeds, and their motors.

    A task may have other vehicles, such as `sim_pybullet.tasks.track_racing.RacingCars`: they have
    actions, each as two numbers, and ``counted``, ``reset``, ``step`` and ``expert`` as these.
    """

    expert = staticmethod(expert_actions)

    def __init__(self, n_robots: int, actions: ActionTable = FIVE_ACTIONS) -> None:
        super().__init__(n_robots)
        self.actions, self._table = actions, np.array(actions)

    def step(self, actions: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        """The ``twists`` after one more step under actions (N,), or any pairs (N, 2) from -1 to 1.

        Pairs are rim speeds as shares of the greatest of our actions.
        """
        speeds = self._table[actions] if actions.ndim == 1 else MAX_WHEEL_MPS * actions
        return super().step(speeds, rng)


def pursuit(paths: PathBatch, poses: np.ndarray, ahead_m: np.ndarray) -> np.ndarray:
    """(N,) curvature [1/m] of the circles that lead from poses (N, 3) to places on the paths (N,).

    Coulter 1992, "Implementation of the Pure Pursuit Path Tracking Algorithm": the circle that
    leaves along the robot's heading and meets the path a fixed way ahead.
    """
    delta = paths.points_at(ahead_m[:, None])[:, 0] - poses[:, :2]
    left = np.cos(poses[:, 2]) * delta[:, 1] - np.sin(poses[:, 2]) * delta[:, 0]
    return np.asarray(2.0 * left / np.maximum((delta**2).sum(axis=1), 1e-6))
