"""The environment of a run, as stable-baselines3 sees it."""

from __future__ import annotations

from stable_baselines3.common.vec_env import VecEnv, VecEnvWrapper
from stable_baselines3.common.vec_env.base_vec_env import VecEnvObs, VecEnvStepReturn


class ScaledReward(VecEnvWrapper):
    """Multiplies rewards, so that values lie near 1, where losses and gradients are made for."""

    def __init__(self, env: VecEnv, scale: float) -> None:
        super().__init__(env)
        self._scale = scale

    def reset(self) -> VecEnvObs:
        """As of the environment."""
        return self.venv.reset()

    def step_wait(self) -> VecEnvStepReturn:
        """As of the environment, the rewards (N,) scaled."""
        observation, rewards, done, infos = self.venv.step_wait()
        return observation, rewards * self._scale, done, infos
