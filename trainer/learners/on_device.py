"""Pictures that never leave the device on which they are drawn and learned from.

stable-baselines3's buffers are arrays on the CPU. They get the pictures' numbers, and the policy,
on the device, looks up what these stand for.
"""

from typing import Any, cast

import numpy as np
import torch
from gymnasium import spaces
from stable_baselines3.common.vec_env import VecEnv

from trainer.config import RunConfig
from trainer.envs import SeenOtherwise, image_changed, parts_of


class PictureStore:
    """The newest of all pictures (H, W, 3 F) that were put here, by number, on a device."""

    def __init__(self, most: int, shape: tuple[int, ...], device: str) -> None:
        self.shape = shape
        self._pictures = torch.zeros((most, *shape), dtype=torch.uint8, device=device)
        self._next = 0

    def put(self, pictures: torch.Tensor) -> np.ndarray:
        """Keep pictures (..., H, W, 3 F); their numbers (...), int64."""
        flat = pictures.reshape(-1, *self.shape)
        numbers = (self._next + np.arange(len(flat))) % len(self._pictures)
        self._pictures[numbers] = flat
        self._next = (self._next + len(flat)) % len(self._pictures)
        return numbers.reshape(pictures.shape[: -len(self.shape)])

    def take(self, numbers: torch.Tensor) -> torch.Tensor:
        """Pictures (N, H, W, 3 F) of these numbers (N,)."""
        return self._pictures[numbers.long()]


class KeptThere(SeenOtherwise):
    """In place of pictures, alone or in a dict as ``image``, their numbers in ``pictures``."""

    def __init__(self, env: VecEnv, config: RunConfig) -> None:
        shown, learn = env.observation_space, config.learn
        rollout = getattr(learn, "rollout", 0) or getattr(learn, "a2c_rollout", 0)
        kept = getattr(learn, "buffer", 0) or rollout * learn.robots
        most = 2 * (kept + learn.robots)  # every step may end an episode, whose last picture counts
        shape = parts_of(shown)["image"].shape
        self.pictures = PictureStore(most, shape, cast(Any, env).device)
        numbers = image_changed(shown, lambda _: spaces.Box(0, most - 1, (), np.int64))
        super().__init__(env, lambda seen, _: image_changed(seen, self.pictures.put), numbers)
