"""PPO: proximal policy optimisation (Schulman et al. 2017), stable-baselines3's."""

from dataclasses import dataclass
from typing import Any, cast

from stable_baselines3 import PPO

from trainer.algorithms import Algorithm, Making, Shares
from trainer.learners.actor_critic import CRUISE, ActorCriticConfig, FallingEntropy, on_policy
from trainer.learners.networks import DrivingActorCritic


@dataclass(frozen=True)
class PpoConfig(ActorCriticConfig):
    """See the module."""

    rollout: int = 64  # steps of each robot between updates
    minibatch: int = 256
    epochs: int = 3
    gae_lambda: float = 0.9
    clip: float = 0.2


class DrivingPPO(FallingEntropy, PPO):
    """With pictures as they are and a falling weight of the entropy."""


def build(making: Making) -> DrivingPPO:
    """A model ready to learn."""
    learn = cast(PpoConfig, making.config.learn)
    rollout = {"n_steps": learn.rollout, "batch_size": learn.minibatch, "n_epochs": learn.epochs}
    means = {"gae_lambda": learn.gae_lambda, "clip_range": learn.clip}
    return on_policy(DrivingPPO, making, **rollout, **means)


_TRACK = {"rollout": 32, "epochs": 4, "learning_rate": 2e-3, "gae_lambda": 0.95, "entropy": 0.05}
_CRUISE = {**CRUISE["learn"], "learning_rate": 1e-3, "rollout": 64}
PRESETS: dict[str, dict[str, Any]] = {
    "navigation": {"steps": 60_000, "true_path": 1.0},
    "track": {"steps": 160_000, "learn": _TRACK},
    "cruise": {**CRUISE, "learn": _CRUISE, "true_path": 1.0},
    "debug": {"learn": {"robots": 4, "rollout": 16, "minibatch": 32}},
}
_SHARES = Shares({"rollout": 16, "minibatch": 32})
ALGORITHM = Algorithm("PPO", PpoConfig(), DrivingActorCritic, build, PRESETS, shares=_SHARES)
