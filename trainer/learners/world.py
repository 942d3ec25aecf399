"""The world of a run, as what learns there sees it."""

from pathlib import Path
from typing import Any, cast

import numpy as np
from gymnasium import spaces
from stable_baselines3.common.vec_env import VecEnv

from robot.contract import PATH_POINTS
from robot.navigation.path import path_inputs
from sim_pybullet.vec_env import DuckpilotVecEnv
from trainer.algorithms import EnvMaker
from trainer.config import RunConfig
from trainer.envs import SeenOtherwise, image_changed, parts_of
from trainer.learners.backbone import Seer
from trainer.learners.on_device import KeptThere
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
