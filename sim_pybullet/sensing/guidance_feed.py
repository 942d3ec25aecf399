"""``GuidanceFeed``: the path inputs of N robots as they would compute them, from what they know."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from robot.contract import CONTROL_DT_S
from robot.navigation.fusion import PoseFusion
from robot.navigation.guidance import path_inputs
from robot.navigation.path_batch import PathBatch
from sim_pybullet.look import PoseLook
from sim_pybullet.motors import PHYSICS_DT_S
from sim_pybullet.sensing.pose_error import PoseError


class GuidanceFeed:
    """Between the true poses and the policy.

    Every robot fuses the overhead poses that its ``PoseLook`` lets through with the steps of its
    wheels, by the filter that real robots run (`robot.navigation.fusion`), and follows its path
    from where it believes to be. A robot whose ``PoseLook`` has no error knows its true pose.

    Attributes:
        poses: (N, 3) where the robots believe to be: x [m], y [m], heading [rad].
    """

    def __init__(self, n_robots: int) -> None:
        self.poses = np.zeros((n_robots, 3))
        self._exact = np.ones(n_robots, dtype=bool)
        self._errors, self._fusion = PoseError(n_robots), PoseFusion(n_robots)
        self._driven = np.zeros((n_robots, 2))  # [m] and [rad] since the last decision
        self._hints = np.zeros(n_robots, dtype=int)
        self._decisions = self._moved = 0  # so far, and when the filter moved last
        self._move()

    def begin(
        self,
        robots: np.ndarray,
        looks: Sequence[PoseLook],
        poses: np.ndarray,
        hints: np.ndarray,
        rngs: Sequence[np.random.Generator],
    ) -> None:
        """These robots (M,) begin an episode where they have stood long enough to know it.

        ``looks`` and ``rngs`` are theirs; ``poses`` (N, 3) are true, and ``hints`` (N,) say where
        all robots are on their paths, see `robot.navigation.path_batch.PathBatch.index_at`.
        """
        for i, look, rng in zip(robots.tolist(), looks, rngs, strict=True):
            self._exact[i] = replace(look, correlation_s=PoseLook.correlation_s) == PoseLook()
            self._errors.reset(i, look, rng)
        if not self._exact[robots].all():
            if self._moved < self._decisions:
                self._move()
            told = np.full_like(poses, np.nan)
            told[robots] = self._errors.of_standing(poses)[robots]
            self._fusion.reset(robots)
            self._fusion.measure(told, np.full(len(poses), self._now_s))
        self._hints[robots] = hints[robots]
        self._driven[robots] = 0.0
        self._believe(poses)

    def record(self, counted: np.ndarray) -> None:
        """One physics step at these twists (N, 2), see `sim_pybullet.motors.MotorModel.counted`."""
        self._driven += counted * PHYSICS_DT_S

    def update(self, poses: np.ndarray, rng: np.random.Generator) -> None:
        """A decision led to these true poses (N, 3)."""
        self._decisions += 1
        if self._exact.all():
            self._driven[:] = 0.0  # nobody needs the filter
        else:
            self._move()
            self._fusion.measure(*self._errors.observe(poses, self._now_s, rng))
        self._believe(poses)

    def path_inputs(self, paths: PathBatch) -> np.ndarray:
        """(N, 10) float32, see `robot.navigation.guidance.path_inputs`, on paths of the robots."""
        at = paths.project(self.poses[:, :2], self._hints)
        self._hints = at.index
        return path_inputs(paths, self.poses, at.arc_m)

    @property
    def _now_s(self) -> float:
        return self._decisions * CONTROL_DT_S

    def _move(self) -> None:
        forward_m, turn_rad = self._driven.T.copy()
        self._fusion.move(forward_m, turn_rad, self._now_s)
        self._moved = self._decisions
        self._driven[:] = 0.0

    def _believe(self, poses: np.ndarray) -> None:
        self.poses = np.where(self._exact[:, None], poses, self._fusion.poses)
