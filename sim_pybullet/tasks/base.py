"""``Task``: what a batch of robots is asked to do, apart from bodies, cameras and the loop."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple, Protocol

import numpy as np

from robot.navigation.path_batch import PathBatch
from sim_pybullet.tasks.following import Course
from sim_pybullet.vehicle import Vehicle

if TYPE_CHECKING:
    from sim_pybullet.scenery.place import Place


class Starts(NamedTuple):
    """Where M robots begin an episode."""

    poses: np.ndarray  # (M, 3): x [m], y [m], heading [rad]
    maps: np.ndarray  # (M,) int, index into the task's road_maps


class TaskStep(NamedTuple):
    """What one decision of N robots led to. The reward is the sum of its terms."""

    terms: np.ndarray  # (T, N), in the order of the task's term_names
    facts: np.ndarray  # (F, N), in the order of the task's fact_names
    terminated: np.ndarray  # (N,) bool: failed, nothing more to be gained
    truncated: np.ndarray  # (N,) bool: cut off, by success or by the step limit
    success: np.ndarray  # (N,) bool

    @property
    def reward(self) -> np.ndarray:
        """(N,)."""
        return np.asarray(self.terms.sum(axis=0))


class Task(Protocol):
    """One task of N robots, each in an episode of its own."""

    n_robots: int
    term_names: tuple[str, ...]  # of the reward
    fact_names: tuple[str, ...]  # of what else is worth knowing of a robot's episode
    guided: bool  # whether the policy gets path_input beside the picture
    frames: int  # how many of the last pictures the policy gets

    @property
    def road_maps(self) -> Sequence[Place]:
        """The maps or tracks that robots may be on."""

    @property
    def vehicle(self) -> Vehicle:
        """What carries out the robots' actions."""

    @property
    def paths(self) -> PathBatch:
        """The path that each robot should follow now."""

    @property
    def course(self) -> Course:
        """Where each robot is on its path, after the last ``reset`` or ``step``."""

    @property
    def half_lane_m(self) -> np.ndarray:
        """(N,) distance from the path at which a robot leaves its lane."""

    def reset(
        self, robots: np.ndarray, rng: np.random.Generator, number: int | None = None
    ) -> Starts:
        """Begin an episode for these robots: indices (M,).

        With a number, what could be drawn among several (map, lane, manoeuvre) is taken in turn.
        """

    def reset_at(self, robots: np.ndarray, poses: np.ndarray, rng: np.random.Generator) -> Starts:
        """Begin an episode for these robots (M,) at these poses (M, 3) of the only map."""

    def step(self, poses: np.ndarray, collided: np.ndarray) -> TaskStep:
        """Judge one decision by the poses (N, 3) that it led to; ``collided`` is (N,) bool."""
