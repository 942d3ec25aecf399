"""Who drives the robots of a challenge."""

import numpy as np

from robot.contract import MAX_WHEEL_MPS, ImageSpec
from sim_pybullet.batch import BatchWorld, Observation
from trainer.judging.evaluate import DrivingPolicy, _choose

_SMALL = ImageSpec(40, 30)  # for films: who does not look needs no more


class Driver:
    """Who drives all robots of a world once, from their start; this one never moves."""

    guided = False  # whether it gets a path
    image = _SMALL  # what is drawn for it,
    frames = 1  # of it so many at once

    def choose(self, world: BatchWorld, seen: Observation) -> np.ndarray:  # noqa: ARG002
        """(N,) numbers of actions, or (N, 2) shares of the greatest wheel speed."""
        return np.zeros((world.n_robots, 2))


class Expert(Driver):
    """Knows where everybody is."""

    def choose(self, world: BatchWorld, seen: Observation) -> np.ndarray:  # noqa: ARG002
        """See `Driver`."""
        return world.expert_actions()


class Pilot(Driver):
    """A policy, greedily."""

    def __init__(self, policy: DrivingPolicy) -> None:
        self._policy = policy
        self.guided, self.image = policy.contract.path_points > 0, ImageSpec()
        self.frames = policy.contract.frames

    def choose(self, world: BatchWorld, seen: Observation) -> np.ndarray:
        """See `Driver`."""
        choices = np.zeros(world.n_robots, dtype=int)
        for robot in np.flatnonzero(world.active).tolist():
            choices[robot] = _choose(self._policy, seen, robot, None)
        return np.array(self._policy.contract.actions)[choices] / MAX_WHEEL_MPS
