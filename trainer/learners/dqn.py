"""Double DQN on stable-baselines3's DQN: the double target and, where wanted, advantage learning.

stable-baselines3 has plain DQN only. Its loop, schedules, n-step buffer and soft target update
are used as they are; plain or dueling is the policy's affair (`trainer.learners.networks`).

Advantage learning (Baird 1999; Bellemare et al. 2016, "Increasing the Action Gap", eq. 7) takes a
share of what the action is worth less than the best one off its target. That leaves the best
action what it is, and drives the others' values down 1 / (1 - share) times as far. With a decision
every 0.1 s one wrong action costs next to nothing, so that without it noise chooses.
"""

from __future__ import annotations

from typing import Any, cast

import numpy as np
import torch
from stable_baselines3 import DQN
from stable_baselines3.common.type_aliases import GymEnv
from stable_baselines3.common.vec_env import VecEnv
from torch.nn.functional import smooth_l1_loss

from trainer.learners.networks import QPolicy


class ChannelLast:
    """Leaves pictures as (H, W, 3), where stable-baselines3 would copy them to (3, H, W)."""

    @staticmethod
    def _wrap_env(env: GymEnv, *_: Any, **__: Any) -> VecEnv:
        if not isinstance(env, VecEnv):
            raise TypeError(f"expected a stable-baselines3 VecEnv, got {type(env).__name__}")
        return env


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
        assert self.replay_buffer is not None
        batch: Any = self.replay_buffer.sample(batch_size)
        with torch.no_grad():
            chosen = self.q_net(batch.next_observations).argmax(dim=1, keepdim=True)
            following = self.q_net_target(batch.next_observations).gather(1, chosen)
            target = batch.rewards + (1.0 - batch.dones) * batch.discounts * following
            if self.action_gap:
                target -= self.action_gap * self._shortfall(batch)
        policy = cast(QPolicy, self.policy)
        values, path_loss = policy.values_and_path_loss(batch.observations)
        chosen = values.gather(1, batch.actions.long())
        return self._descend(smooth_l1_loss(chosen, target) + path_loss)

    def _shortfall(self, batch: Any) -> torch.Tensor:
        """(B, 1) by how much the actions taken are worth less than the best ones."""
        values = self.q_net_target(batch.observations)
        return values.max(dim=1, keepdim=True).values - values.gather(1, batch.actions.long())

    def _descend(self, loss: torch.Tensor) -> float:
        self.policy.optimizer.zero_grad()
        loss.backward()
        torch.nn.utils.clip_grad_norm_(self.q_net.parameters(), self.max_grad_norm)
        self.policy.optimizer.step()
        return loss.item()
