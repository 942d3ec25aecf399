"""DAgger (Ross, Gordon and Bagnell 2011): imitate an expert on the states the learner meets.

The robots are driven by a mixture of expert and learner; whoever drives, what is stored and
learned is the expert's choice. That fits stable-baselines3's off-policy loop, which keeps apart
the action taken and the action stored.
"""

from dataclasses import dataclass
from typing import Any, cast

import numpy as np
from stable_baselines3.common.noise import ActionNoise
from stable_baselines3.common.policies import ActorCriticPolicy
from torch.nn.functional import cross_entropy
from typing_extensions import override

from trainer.algorithms import Algorithm, LearnConfig, Making, Shares, ddqn
from trainer.learners.coach import find_coach, told
from trainer.learners.networks import ImitatingPolicy
from trainer.learners.replay import off_policy
from trainer.resumable import descend


@dataclass(frozen=True)
class DaggerConfig(LearnConfig):
    """See the module."""

    robots: int = 16
    max_grad_norm: float = 10.0
    batch: int = 128
    dagger_every: int = 4  # steps of all robots between updates
    gradient_steps: int = 2
    buffer: int = 40_000
    warm_up: int = 500
    expert_steps: int = 2_000  # over which the expert's share of the driving falls from 1 to 0
    random_share: float = 0.08  # of the actions, so that recoveries are seen
    untold_share: float = 0.6  # of what is learned from, without the last commands
    coach_steps: int = 0  # by which the expert is learned, see `trainer.learners.coach`; 0: a rule


class Dagger(ddqn.DoubleDQN):
    """``q_net`` gives the learner's logits; the target network lies idle."""

    coach: ActorCriticPolicy | None = None  # whom it imitates; without, the vehicle's own expert
    expert_steps = 1
    random_share = untold_share = 0.0
    commands = 0
    rng: np.random.Generator

    @override
    def _sample_action(
        self, learning_starts: int, action_noise: ActionNoise | None = None, n_envs: int = 1
    ) -> tuple[np.ndarray, np.ndarray]:
        assert self.env is not None
        assert self._last_obs is not None
        env: Any = self.env.unwrapped  # has a world
        if self.coach is None:
            expert = env.world.expert_actions().astype(np.int64)
        else:
            expert, _ = self.coach.predict(told(env.world), deterministic=True)
        learner, _ = self.policy.predict(self._last_obs, deterministic=True)
        share = max(0.0, 1.0 - self.num_timesteps / self.expert_steps)
        taken = np.where(self.rng.random(n_envs) < share, expert, learner)
        choices = self.rng.integers(int(self.q_net.action_space.n), size=n_envs)
        return np.where(self.rng.random(n_envs) < self.random_share, choices, taken), expert

    def _update(self, batch_size: int) -> float:
        assert self.replay_buffer is not None
        batch: Any = self.replay_buffer.sample(batch_size)
        if self.commands:  # a picture by itself must do: at rest, and of whom nothing else is known
            untold = self.rng.random(batch_size) < self.untold_share
            batch.observations["path"][untold, -2 * self.commands :] = 0.0
        logits = cast(ImitatingPolicy, self.policy).logits(batch.observations)
        loss = cross_entropy(logits, batch.actions.flatten().long())
        return descend(self.policy.optimizer, loss, self.max_grad_norm)


def build(making: Making) -> Dagger:
    """A model ready to learn; its coach is taught before, if it has one."""
    learn = cast(DaggerConfig, making.config.learn)
    model = Dagger(**off_policy(making, n_steps=1, gamma=0.0), train_freq=learn.dagger_every)
    model.expert_steps, model.random_share = learn.expert_steps, learn.random_share
    model.untold_share, model.commands = learn.untold_share, making.config.commands
    model.rng = np.random.default_rng(making.config.seed)
    if learn.coach_steps:
        path, steps = making.folder.coach, learn.coach_steps
        model.coach = find_coach(path, making.config, steps, making.console)
    return model


PRESETS: dict[str, dict[str, Any]] = {
    "track": {"steps": 16_000},
    "cruise": {"learn": {"learning_rate": 1e-3, "gradient_steps": 4, "random_share": 0.3}},
    "debug": ddqn.PRESETS["debug"],
}
_SHARES = Shares({"dagger_every": 1, "batch": 32, "buffer": 1, "warm_up": 1, "expert_steps": 1})
ALGORITHM = Algorithm("DAgger", DaggerConfig(), ImitatingPolicy, build, PRESETS, shares=_SHARES)
