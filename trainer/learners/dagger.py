"""DAgger (Ross, Gordon and Bagnell 2011): imitate an expert on the states the learner meets.

The robots are driven by a mixture of expert and learner; whoever drives, what is stored and
learned is the expert's choice. That fits stable-baselines3's off-policy loop, which keeps apart
the action taken and the action stored.
"""

from __future__ import annotations

from typing import Any, Protocol, cast

import numpy as np
from stable_baselines3.common.noise import ActionNoise
from torch.nn.functional import cross_entropy
from typing_extensions import override

from sim_pybullet.batch import BatchWorld
from trainer.learners.coach import Coach
from trainer.learners.dqn import DoubleDQN


class HasExpert(Protocol):
    """What an environment needs for imitation."""

    world: BatchWorld  # of who has a coach

    def expert_actions(self) -> np.ndarray:
        """What the expert would do now, (N,) int."""


class Dagger(DoubleDQN):
    """``q_net`` gives the learner's logits; the target network lies idle."""

    coach: Coach | None = None  # whom it imitates; without, the vehicle's own expert
    expert_steps = 1
    random_share = 0.0

    @override
    def _sample_action(
        self, learning_starts: int, action_noise: ActionNoise | None = None, n_envs: int = 1
    ) -> tuple[np.ndarray, np.ndarray]:
        assert self.env is not None
        assert self._last_obs is not None
        env = cast(HasExpert, self.env.unwrapped)
        expert = env.expert_actions() if self.coach is None else self.coach.actions(env.world)
        expert = expert.astype(np.int64)
        learner, _ = self.policy.predict(self._last_obs, deterministic=True)
        share = max(0.0, 1.0 - self.num_timesteps / self.expert_steps)
        taken = np.where(self._rng.random(n_envs) < share, expert, learner)
        choices = self._rng.integers(int(self.q_net.action_space.n), size=n_envs)
        taken = np.where(self._rng.random(n_envs) < self.random_share, choices, taken)
        return taken, expert

    def _setup_model(self) -> None:
        super()._setup_model()
        self._rng = np.random.default_rng(self.seed)

    def _update(self, batch_size: int) -> float:
        assert self.replay_buffer is not None
        batch: Any = self.replay_buffer.sample(batch_size)
        logits = self.q_net(batch.observations)
        return self._descend(cross_entropy(logits, batch.actions.flatten().long()))
