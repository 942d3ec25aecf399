"""The environment of a run, as stable-baselines3 sees it."""

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
import torch
from gymnasium import spaces
from stable_baselines3.common.vec_env import VecEnv, VecEnvWrapper
from stable_baselines3.common.vec_env.base_vec_env import VecEnvObs, VecEnvStepReturn

from robot.errors import ConfigError
from robot.inference.policy import open_translator
from sim_pybullet.batch import BatchWorld
from sim_pybullet.rendering.ray_camera import BatchCamera
from sim_pybullet.tasks.spec import Choices, find_task
from sim_pybullet.vec_env import DuckpilotVecEnv
from trainer.algorithms import find_algorithm
from trainer.config import RunConfig
from trainer.division import refuse_judging_look, refuse_judging_maps

_FEWEST_LOOKS = 4  # of each map


def make_env(
    config: RunConfig, robots: int, seed: int, camera: BatchCamera | None = None
) -> DuckpilotVecEnv:
    """The world of a run with so many robots; rewards are the task's own.

    DuckpilotError for a map, look or translator that is absent, does not fit, or is for judging.
    """
    spec, image = find_task(config.task), config.image
    places = [spec.load(name) for name in config.maps]
    refuse_judging_maps(places)
    refuse_judging_look(config.look)
    lane, style = config.lane if spec.lanes else None, config.style if spec.styles else None
    task = spec.build(places, robots, Choices(lane, style, start_spread=config.start_spread))
    looks = spec.looks(config.look, config.pose_error, config.without)
    painted = spec.painted // config.workers  # each process of a run paints its own
    pool_size = max(painted // len(task.road_maps), _FEWEST_LOOKS)
    translator = open_translator(config.translate, image) if config.translate else None
    if camera is None and draws_on_gpu(config):
        from sim_pybullet.rendering.torch_camera import TorchCamera

        camera = TorchCamera(image, robots, task.movers)
    how = seed, pool_size, camera, translator
    return DuckpilotVecEnv(BatchWorld(task, looks, image, *how, commands=config.commands))


def draws_on_gpu(config: RunConfig) -> bool:
    """Whether pictures are drawn where the network is: on a GPU, unless arrays are wanted of them.

    ConfigError: a GPU is asked for, and there is none.
    """
    if config.device == "cpu":
        return False
    found = torch.cuda.is_available()
    if config.device == "cuda" and not found:
        raise ConfigError("device: expected cpu or auto, since torch finds no GPU here; got 'cuda'")
    arrays = config.translate or config.relit or find_algorithm(config.algorithm).shares is None
    return found and not arrays


def parts_of(observation: Any) -> dict[str, Any]:
    """What robots see, or the boxes of what they may see, by name; of pictures alone ``image``."""
    return dict(observation) if isinstance(observation, Mapping) else {"image": observation}


def image_changed(observation: Any, change: Callable[[Any], Any]) -> Any:
    """What robots see, or may see, pictures or a dict with them as ``image``, these changed."""
    if isinstance(observation, (dict, spaces.Dict)):
        return type(observation)({**observation, "image": change(observation["image"])})
    return change(observation)


class SeenOtherwise(VecEnvWrapper):
    """Robots see what a function makes of what their environment shows.

    ``see`` is given what all robots see and None, or what a robot saw last in an episode that has
    ended, and its number; ``space`` is of what comes of it, if it is another. ``reward_scale``
    brings values near 1, where losses and gradients are made for.
    """

    def __init__(
        self,
        env: VecEnv,
        see: Callable[[Any, int | None], Any],
        space: spaces.Space | None = None,
        reward_scale: float = 1.0,
    ) -> None:
        super().__init__(env, space)
        self._see, self._scale = see, reward_scale

    def reset(self) -> VecEnvObs:
        """Seen otherwise."""
        return self._see(self.venv.reset(), None)

    def step_wait(self) -> VecEnvStepReturn:
        """Seen otherwise."""
        seen, rewards, done, infos = self.venv.step_wait()
        for i in np.flatnonzero(done).tolist():
            infos[i]["terminal_observation"] = self._see(infos[i]["terminal_observation"], i)
        return self._see(seen, None), rewards * self._scale, done, infos
