"""``DriveVectorEnv``: N robots as a vector environment of Gymnasium."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space

from robot.contract import CONTROL_DT_S
from sim_pybullet import spaces
from sim_pybullet.batch import BatchWorld


class DriveVectorEnv(VectorEnv[Any, Any, Any]):
    """The robots of a ``BatchWorld``: arguments and all else as of `sim_pybullet.env.DriveEnv`.

    A robot whose episode ends begins the next one within the same step
    (``AutoresetMode.SAME_STEP``): ``final_obs`` and ``final_info`` hold the end of the old one.
    """

    metadata: dict[str, Any] = {  # noqa: RUF012 (as the base class has it)
        "render_modes": ["rgb_array"],
        "render_fps": round(1.0 / CONTROL_DT_S),
        "autoreset_mode": AutoresetMode.SAME_STEP,
    }

    def __init__(
        self, world: BatchWorld, render_mode: str | None = None, continuous: bool = False
    ) -> None:
        self.world, self.render_mode, self.num_envs = world, render_mode, world.n_robots
        self.single_observation_space = spaces.observation_space(world)
        self.single_action_space = spaces.action_space(world, continuous)
        self.observation_space = batch_space(self.single_observation_space, self.num_envs)
        self.action_space = batch_space(self.single_action_space, self.num_envs)
        self._seen = np.zeros((self.num_envs, *world.image_shape[:2], 3), np.uint8)

    def reset(
        self, *, seed: int | Sequence[int | None] | None = None, options: Any = None
    ) -> tuple[Any, dict[str, Any]]:
        """Begin an episode of every robot; of several seeds the first counts for all.

        DuckpilotError for options other than ``pose``, (3,) for all or (N, 3), or where no episode
        can begin.
        """
        poses = spaces.start_poses(options, self.num_envs)
        first = seed if seed is None or isinstance(seed, int) else seed[0]
        super().reset(seed=first)
        if first is not None:
            self.world.seed(int(self.np_random.integers(spaces.SEEDS)))
        observation = self.world.reset(poses)
        self._seen = spaces.newest_picture(observation.image)
        return spaces.as_space_member(observation), {}

    def step(self, actions: Any) -> tuple[Any, np.ndarray, np.ndarray, np.ndarray, dict[str, Any]]:
        """Carry out one action of each robot for 0.1 s."""
        step = self.world.step(actions)
        ended = {int(i): k for k, i in enumerate(step.finished.robots)}
        infos: dict[str, Any] = {}
        for i, info in enumerate(spaces.step_infos(self.world, step)):
            if i in ended:
                last = spaces.as_space_member(step.finished.observation, ended[i])
                info = {"final_obs": last, "final_info": info}
            infos = self._add_info(infos, info, i)
        self._seen = spaces.newest_picture(step.observation.image)
        seen = spaces.as_space_member(step.observation)
        return seen, step.reward, step.task.terminated, step.task.truncated, infos

    def render(self) -> tuple[np.ndarray, ...] | None:
        """The picture (H, W, 3) uint8 that each robot saw last; None unless ``rgb_array``."""
        return tuple(self._seen.copy()) if self.render_mode == "rgb_array" else None

    def close_extras(self, **kwargs: Any) -> None:  # noqa: ARG002
        """Free the world."""
        self.world.close()
