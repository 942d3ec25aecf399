"""A2C: advantage actor-critic (Mnih et al. 2016, without the asynchrony), stable-baselines3's."""

from dataclasses import dataclass
from typing import Any, cast

from stable_baselines3 import A2C

from trainer.algorithms import Algorithm, Making
from trainer.learners.actor_critic import CRUISE, ActorCriticConfig, FallingEntropy, on_policy
from trainer.learners.networks import DrivingActorCritic


@dataclass(frozen=True)
class A2cConfig(ActorCriticConfig):
    """See the module."""

    learning_rate: float = 1e-3
    a2c_rollout: int = 8
    gae_lambda: float = 0.9


class DrivingA2C(FallingEntropy, A2C):
    """With pictures as they are and a falling weight of the entropy."""


def build(making: Making) -> DrivingA2C:
    """A model ready to learn."""
    learn = cast(A2cConfig, making.config.learn)
    own = {"n_steps": learn.a2c_rollout, "gae_lambda": learn.gae_lambda, "use_rms_prop": False}
    return on_policy(DrivingA2C, making, **own)


PRESETS: dict[str, dict[str, Any]] = {
    "navigation": {"steps": 60_000, "true_path": 1.0},
    "track": {"learn": {"entropy": 0.02}},  # of rewards of some 0.1 a decision
    "cruise": {**CRUISE, "true_path": 1.0},
    "debug": {"learn": {"robots": 4}},
}
ALGORITHM = Algorithm("A2C", A2cConfig(), DrivingActorCritic, build, PRESETS)
