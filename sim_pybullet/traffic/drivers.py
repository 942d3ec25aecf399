"""``Drivers``: cars that are not ours, on tours, each with a speed and a temper."""

import numpy as np

from robot.contract import CONTROL_DT_S
from robot.navigation.path import Path, PathBatch
from sim_pybullet.traffic.scenario import Scenario

HEIGHT_M = 0.135
GAP_M = 0.1  # left to whatever a car stands behind, beside the distance at which they meet
LINE_S = 0.6  # a car nears the place where it will stand within about so long
_FASTER_MPS2, _SLOWER_MPS2 = 0.4, 1.2
_WEAVE_M, _WEAVE_EVERY_M = 0.008, 0.25  # to each side, and way per radian
_RIGHT_M = 0.015  # of the middle: in bends two lanes come within 0.18 m of each other
_MISTAKES = 32  # drawn when an episode begins
_MISTAKE_S = 1.0


class Drivers:
    """G groups of C cars, none of which is there at first."""

    def __init__(self, groups: int, count: int, path: Path) -> None:
        shape = (groups, count)
        self._paths = PathBatch([path] * max(1, groups * count), np.arange(groups * count))
        self._here = np.zeros(shape, dtype=bool)
        self.speeds_mps, self.arc_m = np.zeros(shape), np.zeros(shape)
        self.headways_s, self.obeying = np.ones(shape), np.ones(shape, dtype=bool)
        self._cruise_mps, self._clock_s, self._weave_rad = np.zeros((3, *shape))
        self._mistakes_s = np.zeros((*shape, _MISTAKES))
        # x [m], y [m], heading [rad], NaN where there is no car; [m/s]
        self.poses, self.velocities = self._now(), np.zeros((*shape, 2))

    def begin(
        self, group: int, starts: list[tuple[Path, float]], how: Scenario, rng: np.random.Generator
    ) -> None:
        """Cars of one group, each on a path at an arc length [m], at rest."""
        count = self.arc_m.shape[1]
        self.speeds_mps[group] = self._clock_s[group] = 0.0
        self._here[group] = np.arange(count) < len(starts)
        for car, (path, arc_m) in enumerate(starts):
            self._paths.replace(group * count + car, path)
            self.arc_m[group, car] = arc_m
        self._cruise_mps[group] = rng.uniform(*how.npc_speed_mps, count)
        self.headways_s[group] = np.maximum(rng.uniform(*how.npc_headway_s, count), CONTROL_DT_S)
        self.obeying[group] = rng.random(count) < how.npc_obeying
        self._weave_rad[group] = rng.uniform(-np.pi, np.pi, count)
        every_s = 60.0 / max(how.npc_mistakes_per_min, 1e-9)
        self._mistakes_s[group] = rng.exponential(every_s, (count, _MISTAKES)).cumsum(axis=1)
        self.poses, self.velocities[group] = self._now(), 0.0

    def points(self, ahead_m: np.ndarray) -> np.ndarray:
        """(G, C, K, 2) of their paths so far ahead (K,)."""
        where = self.arc_m.reshape(-1, 1) + ahead_m
        return self._paths.points_at(where).reshape(*self.arc_m.shape, len(ahead_m), 2)

    def step(self, free_m: np.ndarray, line_m: np.ndarray) -> None:
        """One decision on: so far (G, C) the way is free, so far off is a line to stand at."""
        room_m = np.maximum(free_m - GAP_M, 0.0)
        wanted = np.minimum(room_m / self.headways_s, np.maximum(line_m, 0.0) / LINE_S)
        since = self._clock_s[..., None] - self._mistakes_s
        asleep = ((since >= 0.0) & (since < _MISTAKE_S)).any(axis=-1)
        wanted = np.where(asleep, self.speeds_mps, np.minimum(wanted, self._cruise_mps))
        most = np.array((-_SLOWER_MPS2, _FASTER_MPS2)) * CONTROL_DT_S
        self.speeds_mps = self.speeds_mps + np.clip(wanted - self.speeds_mps, *most)
        self._clock_s += CONTROL_DT_S
        self.arc_m = self.arc_m + self.speeds_mps * CONTROL_DT_S
        before, self.poses = self.poses, self._now()
        self.velocities = (self.poses - before)[..., :2] / CONTROL_DT_S

    def stand(self, cars: np.ndarray) -> None:
        """Cars (G, C) did not make the last step: something is in their way. They are at rest."""
        if cars.any():
            self.arc_m = self.arc_m - self.speeds_mps * CONTROL_DT_S * cars
            self.speeds_mps = np.where(cars, 0.0, self.speeds_mps)
            self.velocities[cars] = 0.0
            self.poses = self._now()

    def _now(self) -> np.ndarray:
        """(G, C, 3) on their paths, to the right of the middle and weaving a little."""
        where = self.arc_m.reshape(-1, 1)
        x, y = np.moveaxis(self._paths.points_at(where)[:, 0].reshape(*self.arc_m.shape, 2), -1, 0)
        heading = self._paths.headings_at(where).reshape(self.arc_m.shape)
        phase = self.arc_m / _WEAVE_EVERY_M + self._weave_rad
        left_m = _WEAVE_M * np.sin(phase) - _RIGHT_M
        askew = _WEAVE_M / _WEAVE_EVERY_M * np.cos(phase)
        x, y = x - left_m * np.sin(heading), y + left_m * np.cos(heading)
        return np.where(self._here[..., None], np.stack((x, y, heading + askew), axis=-1), np.nan)
