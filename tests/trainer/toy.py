"""A world for the learners: one of five columns is bright, and names the right action.

``python -m tests.trainer.toy ALGORITHM FOLDER STEPS`` trains in it (the test that kills a run).
"""

import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
from rich.console import Console
from stable_baselines3.common.vec_env import DummyVecEnv, VecEnv

from robot.contract import PATH_POINTS, ImageSpec
from trainer.algorithms import Making, find_algorithm
from trainer.config import EvaluationConfig, NetConfig, RunConfig
from trainer.presets import preset
from trainer.run import RunFolder
from trainer.training import watch
from trainer.training.train import train

SIDE_PX = 36
ACTIONS = 5
EPISODE_STEPS = 16


class BrightColumn(gymnasium.Env[Any, Any]):
    """Reward 1 for the bright column's number, else 0; success: at least 15 of 16 right.

    ``with_path`` gives a dict observation in which the path, not the picture, names the action.
    """

    def __init__(self, with_path: bool = False) -> None:
        image = gymnasium.spaces.Box(0, 255, (SIDE_PX, SIDE_PX, 3), np.uint8)
        path = gymnasium.spaces.Box(-1.0, 1.0, (PATH_POINTS,), np.float32)
        both = gymnasium.spaces.Dict({"image": image, "path": path})
        self.observation_space = both if with_path else image
        self.action_space = gymnasium.spaces.Discrete(ACTIONS)
        self.with_path = with_path

    def reset(self, *, seed: int | None = None, options: Any = None) -> tuple[Any, dict[str, Any]]:
        super().reset(seed=seed)
        self.count = self.right = 0
        return self._observe(), {}

    def step(self, action: int) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        reward = float(action == self.bright)
        self.count += 1
        self.right += int(reward)
        over = self.count == EPISODE_STEPS
        info = {"is_success": self.right >= EPISODE_STEPS - 1}
        return self._observe(), reward, False, over, info

    def _observe(self) -> Any:
        self.bright = int(self.np_random.integers(ACTIONS))
        image = self.np_random.integers(0, 60, (SIDE_PX, SIDE_PX, 3), dtype=np.uint8)
        if not self.with_path:
            image[:, 7 * self.bright : 7 * self.bright + 7] += 180
            return image
        path = np.full(PATH_POINTS, self.bright / 2.0 - 1.0, dtype=np.float32)
        return {"image": image, "path": path}


class ToyVecEnv(DummyVecEnv):
    """With the expert that DAgger asks, who is the world's."""

    @property
    def world(self) -> "ToyVecEnv":
        return self

    def expert_actions(self) -> np.ndarray:
        return np.array([env.unwrapped.bright for env in self.envs])


def make_toy(config: RunConfig, robots: int, seed: int) -> ToyVecEnv:
    env = ToyVecEnv([BrightColumn] * robots)
    env.seed(seed)
    return env


def build_model(config: RunConfig, env: VecEnv, folder: Path) -> Any:
    making = Making(config, env, RunFolder(folder), make_toy, Console(quiet=True))
    return find_algorithm(config.algorithm).build(making)


_Q = {"robots": 8, "batch": 32, "buffer": 4_000, "warm_up": 200, "gamma": 0.5}
_Q |= {"epsilon_steps": 1_500, "learning_rate": 1e-3, "target_tau": 0.05}
_DAGGER = {"robots": 8, "batch": 32, "buffer": 4_000, "warm_up": 64, "expert_steps": 400}
QUICK: dict[str, dict[str, Any]] = {
    "ddqn": _Q,
    "dueling": _Q,
    "dagger": _DAGGER,
    "coached": _DAGGER,
    "ppo": {"robots": 8, "rollout": 32, "minibatch": 64, "gamma": 0.5, "learning_rate": 1e-3},
    "a2c": {"robots": 8, "gamma": 0.5},
    "a3c": {"workers": 2, "robots": 4, "gamma": 0.5, "a3c_rollout": 8, "learning_rate": 1e-3},
}


def toy_config(algorithm: str, steps: int, seed: int = 0) -> RunConfig:
    """Small and quick; evaluated once at the end unless solved before."""
    learn = preset("lane", algorithm, "fast").learn
    learn = replace(learn, **QUICK[algorithm])
    return replace(
        preset("lane", algorithm, "fast"),
        learn=learn,
        steps=steps,
        seed=seed,
        reward_scale=1.0,
        image=ImageSpec(SIDE_PX, SIDE_PX),
        net=NetConfig((8, 8, 8), image_fc=32, path_fc=(16, 16), head_fc=32),
        evaluation=EvaluationConfig(episodes=10, every_steps=1_000, stop_after_perfect=1),
    )


def train_toy(config: RunConfig, path: Path) -> Any:
    watch.CHECKPOINT_PERIOD_S = 0.5
    return train(config, RunFolder(path), make_toy, Console(quiet=True))


def main(arguments: Sequence[str]) -> None:
    algorithm, path, steps = arguments
    config = toy_config(algorithm, int(steps))
    endless = replace(config.evaluation, stop_after_perfect=0, every_steps=10**9)
    train_toy(replace(config, evaluation=endless), Path(path))


if __name__ == "__main__":
    main(sys.argv[1:])
