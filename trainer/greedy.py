"""One episode of each robot, driven greedily: the evaluation between updates."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from stable_baselines3.common.vec_env import VecEnv

from trainer.networks import GreedyNetwork

RANDOM_SHARE = 0.2  # of the actions while observations are collected, so that recoveries are seen


@dataclass(frozen=True)
class GreedyResult:
    """First episode of each of N robots."""

    rewards: np.ndarray  # (N,) summed over the episode
    steps: np.ndarray  # (N,) decisions
    success: np.ndarray  # (N,) bool


def drive_greedily(network: GreedyNetwork, env: VecEnv, seed: int) -> GreedyResult:
    """Reset ``env`` with ``seed`` and drive until every robot has ended its first episode."""
    env.seed(seed)
    observation = env.reset()
    count = env.num_envs
    rewards, steps = np.zeros(count), np.zeros(count, dtype=int)
    success, driving = np.zeros(count, dtype=bool), np.ones(count, dtype=bool)
    while driving.any():
        observation, reward, done, infos = env.step(network.actions(observation))  # type: ignore[arg-type]
        rewards += np.where(driving, reward, 0.0)
        steps += driving
        for robot in np.flatnonzero(driving & done):
            success[robot] = bool(infos[robot].get("is_success", False))
        driving &= ~done
    return GreedyResult(rewards, steps, success)


def collect_observations(
    network: GreedyNetwork, env: VecEnv, count: int, rng: np.random.Generator
) -> dict[str, np.ndarray]:
    """``count`` observations from driving with some random actions: {input name: (count, ...)}."""
    observation = env.reset()
    batches = []
    for _ in range(-(-count // env.num_envs)):
        parts = observation if isinstance(observation, dict) else {"image": observation}
        batches.append({name: np.array(part) for name, part in parts.items()})
        chosen = network.actions(observation)  # type: ignore[arg-type]
        random = rng.integers(int(env.action_space.n), size=env.num_envs)  # type: ignore[attr-defined]
        observation, *_ = env.step(
            np.where(rng.random(env.num_envs) < RANDOM_SHARE, random, chosen)
        )
    return {name: np.concatenate([b[name] for b in batches])[:count] for name in batches[0]}
