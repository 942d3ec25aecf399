"""The world of a run, as what learns there sees it."""

from pathlib import Path
from typing import Any, cast

import numpy as np
import torch
from gymnasium import spaces
from stable_baselines3.common.vec_env import VecEnv

from robot.contract import PATH_POINTS
from robot.navigation.path import path_inputs
from sim_pybullet.vec_env import DuckpilotVecEnv
from trainer.algorithms import EnvMaker
from trainer.config import RunConfig
from trainer.envs import SeenOtherwise, image_changed, parts_of
from trainer.learners.backbone import Seer
from trainer.relit import relit

TRUE_PATH = "true_path"


def with_true_path(env: VecEnv) -> SeenOtherwise:
    """Adds ``true_path``, the path inputs (PATH_POINTS,) of true poses, to what N robots see.

    An auxiliary task for navigation, after Jaderberg et al. 2017 ("Reinforcement Learning with
    Unsupervised Auxiliary Tasks"). Reward says little of where on its lane a robot is: a wrong
    decision costs next to nothing. So while it learns, a network also says that path, from the
    layer that its choice is made of, and the picture soon corrects the path that comes of a wrong
    pose. Nothing of it is in what is exported. See `robot.navigation.path`.
    """
    world, space = cast(DuckpilotVecEnv, env).world, env.observation_space

    def see(seen: Any, robot: int | None) -> dict[str, np.ndarray]:
        true = np.zeros(PATH_POINTS, np.float32)  # of an ended episode: nobody learns from it
        if robot is None:
            true = path_inputs(world.task.paths, world.poses, world.task.course.arc_m)
        return {**parts_of(seen), TRUE_PATH: true}

    true_path = spaces.Box(-1.0, 1.0, (PATH_POINTS,), np.float32)
    return SeenOtherwise(env, see, spaces.Dict({**parts_of(space), TRUE_PATH: true_path}))


def under_other_lights(env: VecEnv, rng: np.random.Generator) -> SeenOtherwise:
    """Whatever a robot sees, it sees under a light of its own: one for all frames of a stack."""

    def lit(shown: np.ndarray) -> np.ndarray:
        return relit(shown, rng) if shown.ndim == 3 else np.stack([relit(s, rng) for s in shown])

    return SeenOtherwise(env, lambda seen, _: image_changed(seen, lit))


class PictureStore:
    """The newest of all pictures (H, W, 3 F) that were put here, by number, on a device.

    What is drawn and learned from there never leaves it. stable-baselines3's buffers are arrays on
    the CPU: they get the numbers, and the policy, on the device, looks up what these stand for.
    """

    def __init__(self, most: int, shape: tuple[int, ...], device: str) -> None:
        self.shape = shape
        self._pictures = torch.zeros((most, *shape), dtype=torch.uint8, device=device)
        self._next = 0

    def put(self, pictures: torch.Tensor) -> np.ndarray:
        """Keep pictures (..., H, W, 3 F); their numbers (...), int64."""
        flat = pictures.reshape(-1, *self.shape)
        numbers = (self._next + np.arange(len(flat))) % len(self._pictures)
        self._pictures[numbers] = flat
        self._next = (self._next + len(flat)) % len(self._pictures)
        return numbers.reshape(pictures.shape[: -len(self.shape)])

    def take(self, numbers: torch.Tensor) -> torch.Tensor:
        """Pictures (N, H, W, 3 F) of these numbers (N,)."""
        return self._pictures[numbers.long()]


class KeptThere(SeenOtherwise):
    """In place of pictures, alone or in a dict as ``image``, their numbers in ``pictures``."""

    def __init__(self, env: VecEnv, config: RunConfig) -> None:
        shown, learn = env.observation_space, config.learn
        rollout = getattr(learn, "rollout", 0) or getattr(learn, "a2c_rollout", 0)
        kept = getattr(learn, "buffer", 0) or rollout * learn.robots
        most = 2 * (kept + learn.robots)  # every step may end an episode, whose last picture counts
        shape = parts_of(shown)["image"].shape
        self.pictures = PictureStore(most, shape, cast(Any, env).device)
        numbers = image_changed(shown, lambda _: spaces.Box(0, most - 1, (), np.int64))
        super().__init__(env, lambda seen, _: image_changed(seen, self.pictures.put), numbers)


def learning_world(config: RunConfig, make_env: EnvMaker) -> VecEnv:
    """Of so many robots as learn at once, as they see it; DuckpilotError as of ``make_env``."""
    env = make_env(config, config.learn.robots, config.seed)
    if config.true_path:
        env = with_true_path(env)
    if config.relit:
        env = under_other_lights(env, np.random.default_rng(config.seed))
    if config.net.backbone:
        backbone, shown = Seer(Path(config.net.backbone), config.device), env.observation_space
        width = backbone.width * parts_of(shown)["image"].shape[2] // 3
        said = spaces.Box(-np.inf, np.inf, (width,), np.float32)  # what it saw, for the pictures
        space = image_changed(shown, lambda _: said)
        env = SeenOtherwise(env, lambda seen, _: image_changed(seen, backbone), space)
    elif getattr(env, "device", None):
        env = KeptThere(env, config)
    return SeenOtherwise(env, lambda seen, _: seen, reward_scale=config.reward_scale)
