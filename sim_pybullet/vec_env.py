"""``DuckpilotVecEnv``: N robots as a vector environment of stable-baselines3."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from stable_baselines3.common.vec_env import VecEnv
from stable_baselines3.common.vec_env.base_vec_env import VecEnvIndices, VecEnvStepReturn

from sim_pybullet import env
from sim_pybullet.batch import BatchWorld


class DuckpilotVecEnv(VecEnv):
    """The robots of a ``BatchWorld``: arguments and all else as of `sim_pybullet.env.DriveEnv`.

    A robot whose episode ends begins the next one at once. Its info then holds, as
    stable-baselines3 wants it, ``terminal_observation`` and ``TimeLimit.truncated``.
    """

    def __init__(self, world: BatchWorld, continuous: bool = False) -> None:
        self.world = world
        self._actions = np.zeros(world.n_robots, dtype=int)
        self.render_mode = "rgb_array"
        self.device = world.feed.device  # where pictures are tensors
        seen = env.observation_space(world.feed.shape, world.told)
        super().__init__(world.n_robots, seen, env.action_space(world, continuous))

    def reset(self) -> Any:
        """Begin an episode of every robot; the first seed and the first options count for all."""
        poses = env.start_poses(self._options[0], self.num_envs)
        if self._seeds[0] is not None:
            self.world.seed(self._seeds[0])
        self._reset_seeds()
        self._reset_options()
        return env.as_space_member(self.world.reset(poses))

    def step_async(self, actions: np.ndarray) -> None:
        """Take note of the actions (N,)."""
        self._actions = np.asarray(actions)

    def step_wait(self) -> VecEnvStepReturn:
        """Carry them out for 0.1 s."""
        step = self.world.step(self._actions)
        infos = env.step_infos(self.world, step)
        for info, truncated in zip(infos, step.task.truncated.tolist(), strict=True):
            info["TimeLimit.truncated"] = truncated
        for k, i in enumerate(step.finished.robots):
            infos[i]["terminal_observation"] = env.as_space_member(step.finished.observation, k)
        done = step.task.terminated | step.task.truncated
        return env.as_space_member(step.observation), step.reward.astype(np.float32), done, infos

    def close(self) -> None:
        """Free the world."""
        self.world.close()

    def get_images(self) -> Sequence[np.ndarray | None]:
        """The picture (H, W, 3) uint8 that each robot saw last."""
        return list(self.world.feed.newest)

    def get_attr(self, attr_name: str, indices: VecEnvIndices = None) -> list[Any]:
        """The attribute of this object, for each robot asked for."""
        return [getattr(self, attr_name)] * len(list(self._get_indices(indices)))

    def set_attr(self, attr_name: str, value: Any, indices: VecEnvIndices = None) -> None:
        """Refused: robots have no attributes of their own."""
        raise NotImplementedError(f"DuckpilotVecEnv: cannot set {attr_name!r} of single robots")

    def env_method(self, method_name: str, *_: Any, **__: Any) -> list[Any]:
        """Refused: robots have no methods of their own."""
        raise NotImplementedError(f"DuckpilotVecEnv: cannot call {method_name!r} of single robots")

    def env_is_wrapped(self, wrapper_class: Any, indices: VecEnvIndices = None) -> list[bool]:  # noqa: ARG002
        """Never."""
        return [False] * len(list(self._get_indices(indices)))
