"""The world of a run, as what learns there sees it."""

from __future__ import annotations

import numpy as np
from stable_baselines3.common.vec_env import VecEnv

from trainer.algorithms import EnvMaker
from trainer.config import RunConfig
from trainer.envs import ScaledReward
from trainer.learners.true_path import WithTruePath
from trainer.relit import Relit


def learning_world(config: RunConfig, make_env: EnvMaker) -> VecEnv:
    """Of so many robots as learn at once; DuckpilotError as of ``make_env``."""
    return as_learned(config, make_env(config, config.learn.robots, config.seed))


def as_learned(config: RunConfig, env: VecEnv) -> VecEnv:
    """With what the configuration adds to what robots see."""
    if config.true_path:
        env = WithTruePath(env)
    if config.relit:
        env = Relit(env, np.random.default_rng(config.seed))
    return ScaledReward(env, config.reward_scale)
