"""What actor-critics share: their configuration, a falling weight of the entropy, what they log."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, cast

from stable_baselines3.common.on_policy_algorithm import OnPolicyAlgorithm

from trainer.algorithms import LearnConfig
from trainer.config import RunConfig
from trainer.learners.networks import DrivingActorCritic
from trainer.learners.policies import ChannelLast, Schedule, falling

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
        """As of stable-baselines3; logs entropy and auxiliary loss each by itself."""
        self.ent_coef = self.entropies(self._current_progress_remaining)
        super().train()
        cast(DrivingActorCritic, self.policy).losses.log(self.logger)


def entropies(config: RunConfig) -> Schedule:
    """From the share of the run that is left, 1 to 0, to the weight of the actor's entropy.

    It stops falling before the run ends, so that what is chosen by chance has time to be unlearned.
    """
    fall = falling(cast(ActorCriticConfig, config.learn).entropy, config.entropy_left)
    return lambda left: fall(1.0 - (1.0 - left) / _EXPLORING)
