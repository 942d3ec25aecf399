"""From a `RunConfig` to a stable-baselines3 model with our networks and buffer."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from gymnasium import spaces
from stable_baselines3 import A2C, PPO
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.policies import BasePolicy
from stable_baselines3.common.vec_env import VecEnv
from torch import nn

from trainer.config import SHAPES, A2cConfig, A3cConfig, DaggerConfig, PpoConfig, QConfig, RunConfig
from trainer.learners.dagger import Dagger
from trainer.learners.dqn import ChannelLast, DoubleDQN
from trainer.learners.networks import DrivingActorCritic, DrivingFeatures, DuelingPolicy, QPolicy
from trainer.learners.replay import MappedReplayBuffer

Schedule = Callable[[float], float]

_EXPLORING = 0.6  # of the steps of a run, while the weight of the entropy falls


class ChannelLastPPO(ChannelLast, PPO):
    """stable-baselines3's PPO on pictures as they are, with a falling weight of the entropy."""

    entropies: Schedule

    def train(self) -> None:
        """As of stable-baselines3."""
        self.ent_coef = self.entropies(self._current_progress_remaining)
        super().train()
        _log_losses(self)


class ChannelLastA2C(ChannelLast, A2C):
    """stable-baselines3's A2C on pictures as they are, with a falling weight of the entropy."""

    entropies: Schedule

    def train(self) -> None:
        """As of stable-baselines3."""
        self.ent_coef = self.entropies(self._current_progress_remaining)
        super().train()
        _log_losses(self)


def _log_losses(model: BaseAlgorithm) -> None:
    if isinstance(model.policy, DrivingActorCritic):
        model.policy.losses.log(model.logger)


def build_model(config: RunConfig, env: VecEnv, replay: Path) -> BaseAlgorithm:
    """A model ready to learn; ``replay`` is the folder of its replay buffer, if it has one."""
    common: dict[str, Any] = {
        "policy": policy_class(config),
        "env": env,
        "policy_kwargs": policy_arguments(config),
        "learning_rate": learning_rates(config),
        "max_grad_norm": config.learn.max_grad_norm,
        "seed": config.seed,
        "device": config.device,
    }
    learn = config.learn
    if isinstance(learn, QConfig):
        model = DoubleDQN(**common, **_q_arguments(learn, config.steps, replay))
        model.action_gap = learn.action_gap
        return model
    if isinstance(learn, DaggerConfig):
        return _build_dagger(learn, common, replay)
    if isinstance(learn, PpoConfig):
        ppo = ChannelLastPPO(
            **common,
            gamma=learn.gamma,
            n_steps=learn.rollout,
            batch_size=learn.minibatch,
            n_epochs=learn.epochs,
            gae_lambda=learn.gae_lambda,
            clip_range=learn.clip,
            ent_coef=learn.entropy,
            vf_coef=learn.value,
        )
        ppo.entropies = entropies(config)
        return ppo
    assert isinstance(learn, A2cConfig), "A3C builds itself"
    a2c = ChannelLastA2C(**common, **_a2c_arguments(learn))
    a2c.entropies = entropies(config)
    return a2c


def learning_rates(config: RunConfig) -> Schedule:
    """From the share of the run that is left, 1 to 0, to the learning rate."""
    return _falling(config.learn.learning_rate, config.rate_left)


def entropies(config: RunConfig) -> Schedule:
    """From the share of the run that is left, 1 to 0, to the weight of the actor's entropy.

    It stops falling before the run ends, so that what is chosen by chance has time to be unlearned.
    """
    learn = config.learn
    assert isinstance(learn, (PpoConfig, A2cConfig, A3cConfig))
    fall = _falling(learn.entropy, config.entropy_left)
    return lambda left: fall(1.0 - (1.0 - left) / _EXPLORING)


def _falling(first: float, least: float) -> Schedule:
    return lambda left: first * (least + (1.0 - least) * max(left, 0.0))  # the last step overshoots


def build_policy(config: RunConfig) -> BasePolicy:
    """The policy alone, untrained and without an environment, as export and summary need it."""
    arguments = policy_arguments(config)
    actions = spaces.Discrete(len(SHAPES[config.task].actions))
    arguments["lr_schedule"] = lambda _: config.learn.learning_rate
    return policy_class(config)(observation_space(config), actions, **arguments)


def policy_class(config: RunConfig) -> type[BasePolicy]:
    """Which stable-baselines3 policy the algorithm trains."""
    if isinstance(config.learn, (PpoConfig, A2cConfig, A3cConfig)):
        return DrivingActorCritic
    return DuelingPolicy if config.algorithm == "dueling" else QPolicy


def policy_arguments(config: RunConfig) -> dict[str, Any]:
    """What stable-baselines3 calls ``policy_kwargs``."""
    head = [config.net.head_fc]
    learn = config.learn
    actor_critic = policy_class(config) is DrivingActorCritic
    # in an actor-critic's loss it is multiplied by the weight of the entropy
    share = learn.entropy if isinstance(learn, (PpoConfig, A2cConfig, A3cConfig)) else 1.0
    return {
        "true_path": config.true_path / share if config.true_path else 0.0,
        "features_extractor_class": DrivingFeatures,
        "features_extractor_kwargs": {"net": config.net},
        "net_arch": {"pi": head, "vf": head} if actor_critic else head,
        "activation_fn": nn.ReLU,
        "normalize_images": False,  # the network divides by 255 itself
        "optimizer_kwargs": {"fused": True, "eps": 1e-5 if actor_critic else 1e-8},
    }


def observation_space(config: RunConfig) -> spaces.Space:
    """What the policy of this run sees."""
    height, width, channels = config.image.shape
    shape = SHAPES[config.task]
    image = spaces.Box(0, 255, (height, width, channels * shape.frames), np.uint8)
    if not shape.path_points:
        return image
    path = spaces.Box(-1.0, 1.0, (shape.path_points,), np.float32)
    return spaces.Dict({"image": image, "path": path})


def _q_arguments(learn: QConfig, steps: int, replay: Path) -> dict[str, Any]:
    return {
        "gamma": learn.gamma,
        "batch_size": learn.batch,
        "gradient_steps": learn.gradient_steps,
        "train_freq": 1,
        "buffer_size": learn.buffer,
        "learning_starts": learn.warm_up,
        "tau": learn.target_tau,
        "target_update_interval": learn.robots,  # that is, every step of all robots
        "exploration_fraction": min(1.0, learn.epsilon_steps / steps),
        "exploration_final_eps": learn.epsilon_final,
        **_replay_arguments(replay, learn.n_step, learn.gamma),
    }


def _build_dagger(learn: DaggerConfig, common: dict[str, Any], replay: Path) -> Dagger:
    model = Dagger(
        **common,
        batch_size=learn.batch,
        gradient_steps=learn.gradient_steps,
        train_freq=learn.dagger_every,
        buffer_size=learn.buffer,
        learning_starts=learn.warm_up,
        target_update_interval=learn.robots,
        **_replay_arguments(replay, n_steps=1, gamma=0.0),
    )
    model.expert_steps, model.random_share = learn.expert_steps, learn.random_share
    return model


def _a2c_arguments(learn: A2cConfig) -> dict[str, Any]:
    return {
        "gamma": learn.gamma,
        "n_steps": learn.a2c_rollout,
        "gae_lambda": learn.gae_lambda,
        "ent_coef": learn.entropy,
        "vf_coef": learn.value,
        "use_rms_prop": False,
    }


def _replay_arguments(folder: Path, n_steps: int, gamma: float) -> dict[str, Any]:
    return {
        "replay_buffer_class": MappedReplayBuffer,
        "replay_buffer_kwargs": {"folder": folder, "n_steps": n_steps, "gamma": gamma},
    }
