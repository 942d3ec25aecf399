"""``Ducks``: they stand beside the road, or wait, cross it and come back."""

import numpy as np

from robot.contract import CONTROL_DT_S
from sim_pybullet.traffic.scenario import Scenario

HEIGHT_M = 0.08
_WAITS = 32  # drawn when an episode begins, and then again from the first
_PATIENCE_S = 2.0  # so long it stands in front of a robot, then it goes back
_LOOK_M, _SPACE_M = 0.12, 0.2  # a duck does not walk on while a robot is so near to there


class Ducks:
    """G groups of D ducks, none of which is there at first."""

    def __init__(self, groups: int, count: int) -> None:
        self.poses = np.full((groups, count, 3), np.nan)  # x, y [m], heading; NaN: no duck
        self.velocities = np.zeros((groups, count, 2))  # [m/s]
        self._way_m, self._speed_mps, self._gone_m, self._left_s = np.zeros((4, groups, count))
        self._blocked_s = np.zeros((groups, count))
        self._waits_s = np.zeros((groups, count, _WAITS))
        self._turn = np.zeros((groups, count), dtype=int)

    def begin(self, group: int, at: np.ndarray, how: Scenario, rng: np.random.Generator) -> None:
        """Ducks (K, 4) of one group: x [m], y [m], heading [rad], how far they walk [m]."""
        count = len(at)
        self.poses[group] = np.nan
        self.poses[group, :count], self._way_m[group, :count] = at[:, :3], at[:, 3]
        self._speed_mps[group] = rng.uniform(*how.duckie_speed_mps, self._speed_mps.shape[1])
        self._waits_s[group] = rng.uniform(*how.duckie_wait_s, self._waits_s.shape[1:])
        self._left_s[group] = self._waits_s[group, :, 0]
        self._gone_m[group] = self._blocked_s[group] = 0.0
        self._turn[group], self.velocities[group] = 0, 0.0

    def step(self, robots: np.ndarray) -> None:
        """One decision on, among robots (G, R, 2) [m]."""
        heading = self.poses[..., 2]
        ahead = np.stack((np.cos(heading), np.sin(heading)), axis=-1)
        looks_at = self.poses[..., :2] + _LOOK_M * ahead
        away = robots[:, None] - looks_at[:, :, None]
        walking = (self._left_s <= 0.0) & (self._way_m > 0.0)
        going = walking & ~(np.hypot(away[..., 0], away[..., 1]) < _SPACE_M).any(axis=-1)
        self._left_s -= CONTROL_DT_S * ~walking
        step_m = np.minimum(self._speed_mps * CONTROL_DT_S, self._way_m - self._gone_m) * going
        self.poses[..., :2] += step_m[..., None] * ahead
        self.velocities = (step_m / CONTROL_DT_S)[..., None] * ahead
        self._gone_m += step_m
        over = going & (self._gone_m >= self._way_m - 1e-9)
        self._blocked_s = np.where(walking & ~going, self._blocked_s + CONTROL_DT_S, 0.0)
        back = self._blocked_s > _PATIENCE_S
        self._blocked_s[back] = 0.0
        self.poses[..., 2] = np.where(over | back, heading + np.pi, heading)
        self._gone_m = np.where(over, 0.0, np.where(back, self._way_m - self._gone_m, self._gone_m))
        self._turn[over] = (self._turn[over] + 1) % _WAITS
        waits_s = np.take_along_axis(self._waits_s, self._turn[..., None], axis=-1)[..., 0]
        self._left_s[over] = waits_s[over]
