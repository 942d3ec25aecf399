"""``Drivers``: cars that are not ours, on tours, each with a speed and a temper."""

from __future__ import annotations

import numpy as np

from robot.contract import CONTROL_DT_S
from robot.geometry import compose
from robot.navigation.path import Path
from robot.navigation.path_batch import NO_HINT, PathBatch
from sim_pybullet.traffic.scenario import Scenario
from sim_pybullet.vehicle import LOOKAHEAD_M, pursuit

HEIGHT_M = 0.135
GAP_M = 0.1  # left to whatever a car stands behind, beside the distance at which they meet
LINE_S = 0.6  # a car nears the place where it will stand within about so long
_FASTER_MPS2, _SLOWER_MPS2 = 0.4, 1.2
_TIGHTEST = 1.0 / 0.075  # curvature [1/m], of a robot's hard turn
_MISTAKES = 32  # drawn when an episode begins
_MISTAKE_S = 1.0
_GONE_M = 1e6  # where the paths lie of cars that are not there


class Drivers:
    """G groups of C cars, none of which is there at first.

    Attributes:
        poses: (G, C, 3) x [m], y [m], heading [rad]; NaN where there is no car.
        speeds_mps, headways_s, arc_m: (G, C).
        obeying: (G, C) bool.
        paths: of all cars, group by group.
    """

    def __init__(self, groups: int, count: int, path: Path) -> None:
        shape = (groups, count)
        self.poses = np.full((*shape, 3), np.nan)
        self.velocities = np.zeros((*shape, 2))
        self.speeds_mps, self.arc_m = np.zeros(shape), np.zeros(shape)
        self.headways_s, self.obeying = np.ones(shape), np.ones(shape, dtype=bool)
        self.paths = PathBatch([path] * max(1, groups * count), np.arange(groups * count))
        self._cruise_mps, self._clock_s = np.zeros(shape), np.zeros(shape)
        self._mistakes_s = np.zeros((*shape, _MISTAKES))
        self._hints = np.full(groups * count, NO_HINT)

    def begin(
        self, group: int, starts: list[tuple[Path, float]], how: Scenario, rng: np.random.Generator
    ) -> None:
        """Cars of one group, each on a path at an arc length [m], at rest."""
        count = self.poses.shape[1]
        self.poses[group], self.speeds_mps[group], self._clock_s[group] = np.nan, 0.0, 0.0
        self.velocities[group] = 0.0
        for car, (path, arc_m) in enumerate(starts):
            self.paths.replace(group * count + car, path)
            self.poses[group, car], self.arc_m[group, car] = path.pose_at(arc_m), arc_m
        self._hints[group * count : (group + 1) * count] = NO_HINT
        self._cruise_mps[group] = rng.uniform(*how.npc_speed_mps, count)
        self.headways_s[group] = rng.uniform(*how.npc_headway_s, count)
        self.obeying[group] = rng.random(count) < how.npc_obeying
        every_s = 60.0 / max(how.npc_mistakes_per_min, 1e-9)
        self._mistakes_s[group] = rng.exponential(every_s, (count, _MISTAKES)).cumsum(axis=1)

    @property
    def here(self) -> np.ndarray:
        """(G, C) bool: which cars are there."""
        return np.isfinite(self.poses[..., 0])

    def points(self, ahead_m: np.ndarray) -> np.ndarray:
        """(G, C, K, 2) of their paths so far ahead (K,)."""
        where = self.arc_m.reshape(-1, 1) + ahead_m
        return self.paths.points_at(where).reshape(*self.arc_m.shape, len(ahead_m), 2)

    def step(self, free_m: np.ndarray, line_m: np.ndarray) -> None:
        """One decision on: so far (G, C) the way is free, so far off is a line to stand at."""
        if not self.poses.size:
            return
        room_m = np.maximum(free_m - GAP_M, 0.0)
        wanted = np.minimum(room_m / self.headways_s, np.maximum(line_m, 0.0) / LINE_S)
        since = self._clock_s[..., None] - self._mistakes_s
        asleep = ((since >= 0.0) & (since < _MISTAKE_S)).any(axis=-1)
        wanted = np.where(asleep, self.speeds_mps, np.minimum(wanted, self._cruise_mps))
        change = np.clip(wanted - self.speeds_mps, -_SLOWER_MPS2 * CONTROL_DT_S,
                         _FASTER_MPS2 * CONTROL_DT_S)  # fmt: skip
        self.speeds_mps = self.speeds_mps + change
        self._clock_s += CONTROL_DT_S
        poses = np.nan_to_num(self.poses.reshape(-1, 3), nan=_GONE_M)
        curvature = pursuit(self.paths, poses, self.arc_m.ravel() + LOOKAHEAD_M)
        way_m = self.speeds_mps.ravel() * CONTROL_DT_S
        turned = np.clip(curvature, -_TIGHTEST, _TIGHTEST) * way_m
        chord = np.stack((way_m * np.cos(turned / 2), way_m * np.sin(turned / 2), turned), axis=1)
        after = compose(poses, chord)
        at = self.paths.project(after[:, :2], self._hints)
        self._hints = np.where(self.here.ravel(), at.index, NO_HINT)
        self.arc_m = at.arc_m.reshape(self.arc_m.shape)
        moved = after[:, :2] - poses[:, :2]
        self.velocities = moved.reshape(*self.arc_m.shape, 2) / CONTROL_DT_S
        self.poses = np.where(self.here[..., None], after.reshape(self.poses.shape), np.nan)
