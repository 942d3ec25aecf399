"""Double DQN (van Hasselt et al. 2016) on stable-baselines3's DQN, with advantage learning.

Plain or dueling is the policy's affair.

Advantage learning (Baird 1999; Bellemare et al. 2016, "Increasing the Action Gap", eq. 7) takes a
share of what the action is worth less than the best one off its target. With a decision every 0.1 s
one wrong action costs next to nothing, so that without it noise chooses.
"""

from dataclasses import dataclass
from typing import Any, cast

import numpy as np
import torch
from stable_baselines3 import DQN
from torch.nn.functional import smooth_l1_loss

from trainer.algorithms import Algorithm, LearnConfig, Making, Shares
from trainer.learners.networks import QPolicy
from trainer.learners.policies import ChannelLast
from trainer.learners.replay import MappedReplayBuffer, off_policy
from trainer.resumable import descend


@dataclass(frozen=True)
class QConfig(LearnConfig):
    """Of Double DQN, plain or dueling."""

    robots: int = 16
    max_grad_norm: float = 10.0
    gamma: float = 0.95
    n_step: int = 3
    batch: int = 128
    gradient_steps: int = 1  # per step of all robots
    buffer: int = 40_000  # transitions
    warm_up: int = 500  # random steps before the first update
    target_tau: float = 0.01  # the target network follows by this share each step of all robots
    epsilon_final: float = 0.02
    epsilon_steps: int = 4_000  # from 1 to final
    action_gap: float = 0.0  # advantage learning: 0 none, below 1


class DoubleDQN(ChannelLast, DQN):
    """The online network chooses the next action, the target network values it."""

    action_gap = 0.0

    def train(self, gradient_steps: int, batch_size: int = 100) -> None:
        """``gradient_steps`` updates from the replay buffer."""
        self.policy.set_training_mode(True)
        self._update_learning_rate(self.policy.optimizer)
        losses = [self._update(batch_size) for _ in range(gradient_steps)]
        self._n_updates += gradient_steps
        self.logger.record("train/loss", np.mean(losses))

    def _update(self, batch_size: int) -> float:
        batch: Any = cast(MappedReplayBuffer, self.replay_buffer).sample(batch_size)
        with torch.no_grad():
            chosen = self.q_net(batch.next_observations).argmax(dim=1, keepdim=True)
            following = self.q_net_target(batch.next_observations).gather(1, chosen)
            target = batch.rewards + (1.0 - batch.dones) * batch.discounts * following
            if self.action_gap:  # by how much the actions taken are worth less than the best ones
                values = self.q_net_target(batch.observations)
                best = values.max(dim=1, keepdim=True).values
                target -= self.action_gap * (best - values.gather(1, batch.actions.long()))
        values, path_loss = cast(QPolicy, self.policy).values_and_path_loss(batch.observations)
        chosen = values.gather(1, batch.actions.long())
        loss = smooth_l1_loss(chosen, target) + path_loss
        return descend(self.policy.optimizer, loss, self.max_grad_norm)


def build(making: Making) -> DoubleDQN:
    """A model ready to learn, or to go on with the replay buffer in its folder."""
    config, learn = making.config, cast(QConfig, making.config.learn)
    model = DoubleDQN(
        **off_policy(making, n_steps=learn.n_step, gamma=learn.gamma),
        gamma=learn.gamma,
        train_freq=1,
        tau=learn.target_tau,
        exploration_fraction=min(1.0, learn.epsilon_steps / config.steps),
        exploration_final_eps=learn.epsilon_final,
    )
    model.action_gap = learn.action_gap
    return model


PRESETS: dict[str, dict[str, Any]] = {
    "navigation": {
        "true_path": 1.0,
        "learn": {"gamma": 0.9, "action_gap": 0.8, "epsilon_steps": 10_000},
    },
    "debug": {"learn": {"robots": 4, "buffer": 1_000, "warm_up": 64, "batch": 16}},
}
_SHARES = Shares(
    {"batch": 32, "buffer": 1, "warm_up": 1, "epsilon_steps": 1}, ("gradient_steps", "target_tau")
)
ALGORITHM = Algorithm("Double DQN", QConfig(), QPolicy, build, PRESETS, shares=_SHARES)
