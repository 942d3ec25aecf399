"""Learning to tell the true path: an auxiliary task for navigation.

Reward says little of where on its lane a robot is: a wrong decision costs next to nothing. What it
needs to know the simulator knows: the path input that the true pose would give. While it learns, a
network also says that path, from the layer that its choice is made of; so the picture soon
corrects the path that comes of a wrong pose. Auxiliary tasks after Jaderberg et al. 2017
("Reinforcement Learning with Unsupervised Auxiliary Tasks"); nothing of it is in what is exported.
"""

from __future__ import annotations

from typing import Any, cast

import numpy as np
from gymnasium import spaces
from stable_baselines3.common.vec_env import VecEnv

from robot.contract import PATH_POINTS
from robot.navigation.guidance import path_inputs
from sim_pybullet.vec_env import DuckpilotVecEnv
from trainer.envs import SeenOtherwise, parts_of

TRUE_PATH = "true_path"


class WithTruePath(SeenOtherwise):
    """Adds ``true_path`` to what N robots see: the path inputs (N, PATH_POINTS) of true poses.

    See `robot.navigation.guidance`. The last observation of an ended episode has zeros there:
    nobody learns from it.
    """

    def __init__(self, env: VecEnv) -> None:
        seen = spaces.Box(-1.0, 1.0, (PATH_POINTS,), np.float32)
        space = env.observation_space
        parts = space.spaces if isinstance(space, spaces.Dict) else {"image": space}
        super().__init__(env, spaces.Dict({**parts, TRUE_PATH: seen}))
        self._world = cast(DuckpilotVecEnv, env).world

    def see(self, seen: Any) -> dict[str, np.ndarray]:
        """With the true paths."""
        world = self._world
        true = path_inputs(world.task.paths, world.poses, world.task.course.arc_m)
        return {**parts_of(seen), TRUE_PATH: true}

    def see_last(self, seen: Any, robot: int) -> dict[str, np.ndarray]:  # noqa: ARG002
        """With zeros."""
        return {**parts_of(seen), TRUE_PATH: np.zeros(PATH_POINTS, np.float32)}
