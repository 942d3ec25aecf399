"""One or more episodes of each robot, driven greedily: the evaluation between updates."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from stable_baselines3.common.vec_env import VecEnv

from trainer.envs import parts_of
from trainer.learners.networks import GreedyNetwork

RANDOM_SHARE = 0.2  # of the actions while observations are collected, so that recoveries are seen


class GreedyResult(NamedTuple):
    """The first R episodes of each of N robots."""

    rewards: np.ndarray  # (R, N) summed over the episode
    steps: np.ndarray  # (R, N) decisions
    success: np.ndarray  # (R, N) bool
    distance_m: np.ndarray  # (R, N) from the path, mean of an episode; NaN where nothing tells it


def drive_greedily(
    network: GreedyNetwork,
    env: VecEnv,
    seed: int,
    rounds: int = 1,
    watch: Callable[[np.ndarray], None] | None = None,
) -> GreedyResult:
    """Reset ``env`` with ``seed`` and drive until every robot has ended so many episodes.

    ``watch`` is shown what the first robot sees, (H, W, 3) uint8, in its first episode.
    """
    env.seed(seed)
    observation = env.reset()
    shape = (rounds + 1, env.num_envs)  # one more, for what is driven while others are waited for
    rewards, steps, success = np.zeros(shape), np.zeros(shape, dtype=int), np.zeros(shape, bool)
    off_m = np.zeros(shape)
    which, robots = np.zeros(env.num_envs, dtype=int), np.arange(env.num_envs)
    while (which < rounds).any():
        if watch is not None and not which[0]:
            watch(parts_of(observation)["image"][0, ..., -3:].copy())
        observation, reward, done, infos = env.step(network.actions(observation))  # type: ignore[arg-type]
        rewards[which, robots] += reward
        steps[which, robots] += 1
        off_m[which, robots] += [abs(info.get("offset_m", np.nan)) for info in infos]
        for robot in np.flatnonzero(done):
            success[which[robot], robot] = bool(infos[robot].get("is_success", False))
        which = np.minimum(which + done, rounds)
    means = off_m[:rounds] / steps[:rounds]
    return GreedyResult(rewards[:rounds], steps[:rounds], success[:rounds], means)


def collect_observations(
    network: GreedyNetwork, env: VecEnv, count: int, rng: np.random.Generator
) -> dict[str, np.ndarray]:
    """``count`` observations from driving with some random actions: {input name: (count, ...)}."""
    observation = env.reset()
    batches = []
    for _ in range(-(-count // env.num_envs)):
        batches.append({n: np.array(part) for n, part in parts_of(observation).items()})
        chosen = network.actions(observation)  # type: ignore[arg-type]
        random = rng.integers(int(env.action_space.n), size=env.num_envs)  # type: ignore[attr-defined]
        observation, *_ = env.step(
            np.where(rng.random(env.num_envs) < RANDOM_SHARE, random, chosen)
        )
    return {name: np.concatenate([b[name] for b in batches])[:count] for name in batches[0]}
