"""What actor-critics share: their configuration, a falling weight of the entropy, what they log."""

from dataclasses import dataclass
from typing import Any, TypeVar, cast

import torch
from stable_baselines3.common.on_policy_algorithm import OnPolicyAlgorithm

from trainer.algorithms import LearnConfig, Making
from trainer.config import RunConfig
from trainer.learners.networks import DrivingActorCritic
from trainer.learners.policies import ChannelLast, Schedule, common_arguments, falling

Model = TypeVar("Model", bound="FallingEntropy")
_EXPLORING = 0.6  # of the steps of a run, while the weight of the entropy falls

# Their changes for who cruises on a track, see `sim_pybullet.tasks.track_racing`.
CRUISE: dict[str, Any] = {"learn": {"gamma": 0.9, "entropy": 0.02}, "entropy_left": 0.25}


@dataclass(frozen=True)
class ActorCriticConfig(LearnConfig):
    """Of every actor-critic."""

    gamma: float = 0.95
    entropy: float = 0.01
    value: float = 0.5


class FallingEntropy(ChannelLast, OnPolicyAlgorithm):
    """An algorithm of stable-baselines3 on pictures as they are, its entropy's weight falling."""

    entropies: Schedule

    def train(self) -> None:
        """As of stable-baselines3, which logs the entropy less the path's loss: here each alone."""
        self.ent_coef = self.entropies(self._current_progress_remaining)
        super().train()
        losses = cast(DrivingActorCritic, self.policy).losses
        if losses:
            entropy, path = torch.stack(losses).mean(dim=0).tolist()
            self.logger.record("train/entropy_loss", -entropy)
            self.logger.record("train/path_loss", path)
        losses.clear()


def on_policy(kind: type[Model], making: Making, **own: Any) -> Model:
    """A model of stable-baselines3's ready to learn, with arguments of its ``own``."""
    learn = cast(ActorCriticConfig, making.config.learn)
    usual = {"gamma": learn.gamma, "ent_coef": learn.entropy, "vf_coef": learn.value}
    model = kind(**{**common_arguments(making), **usual, **own})
    model.entropies = entropies(making.config)
    return model


def entropies(config: RunConfig) -> Schedule:
    """From the share of the run that is left, 1 to 0, to the weight of the actor's entropy.

    It stops falling before the run ends, so that what is chosen by chance has time to be unlearned.
    """
    fall = falling(cast(ActorCriticConfig, config.learn).entropy, config.entropy_left)
    return lambda left: fall(1.0 - (1.0 - left) / _EXPLORING)
