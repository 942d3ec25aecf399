"""Sums the rewards and decisions of episodes while they go on, and tells of those that ended."""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.logger import Logger

from trainer.config import RunConfig


class EpisodeEnd(NamedTuple):
    """An episode that ended."""

    robot: int  # counted through all processes
    reward: float  # summed, as the task gives it
    length: int  # decisions
    success: bool


class EpisodeCount:
    """Of N robots from number ``first`` on, whose rewards were multiplied by ``reward_scale``."""

    def __init__(self, robots: int, reward_scale: float, first: int = 0) -> None:
        self._rewards, self._lengths = np.zeros(robots), np.zeros(robots, dtype=int)
        self._scale, self._first = reward_scale, first

    def ended(
        self, rewards: np.ndarray, dones: np.ndarray, infos: list[dict[str, Any]]
    ) -> list[EpisodeEnd]:
        """The episodes that this step of all robots ended."""
        self._rewards += rewards / self._scale
        self._lengths += 1
        ends = []
        for i in np.flatnonzero(dones).tolist():
            success = bool(infos[i].get("is_success", False))
            total, length = float(self._rewards[i]), int(self._lengths[i])
            ends.append(EpisodeEnd(self._first + i, total, length, success))
            self._rewards[i], self._lengths[i] = 0.0, 0
        return ends


class _Tell(BaseCallback):
    def __init__(self, count: EpisodeCount, tell: Callable[[list[EpisodeEnd]], object]) -> None:
        super().__init__()
        self._count, self._tell = count, tell
        self._ended: list[EpisodeEnd] = []

    def _on_step(self) -> bool:
        seen = self.locals
        self._ended += self._count.ended(seen["rewards"], seen["dones"], seen["infos"])
        return True

    def _on_rollout_end(self) -> None:
        self._tell(self._ended)
        self._ended = []


def learn_and_tell(
    model: BaseAlgorithm, config: RunConfig, number: int, tell: Callable[[list[EpisodeEnd]], object]
) -> None:
    """Learn until the run's steps are done, and tell of the episodes of each rollout.

    ``number`` is that of this process among those of the run, which have as many robots each.
    """
    model.set_logger(Logger(None, []))
    robots = config.learn.robots
    heard = _Tell(EpisodeCount(robots, config.reward_scale, number * robots), tell)
    steps = max(0, config.steps - model.num_timesteps)
    model.learn(steps, heard, log_interval=None, reset_num_timesteps=False)  # type: ignore[arg-type]  # no log
