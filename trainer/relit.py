"""Pictures under another light: gain, colour cast and gamma, drawn at random.

Augmentation of what a policy sees while it learns, after Laskin et al. 2020 ("Reinforcement
Learning with Augmented Data"). It helps where classes are painted, too (docs/lab-log.md).
"""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
from stable_baselines3.common.vec_env import VecEnv

from trainer.envs import SeenOtherwise, parts_of

GAINS = (0.7, 1.4)  # of brightness, and of each colour by the square root of it
GAMMAS = (0.7, 1.4)


def draw_light(rng: np.random.Generator) -> np.ndarray:
    """What each grey level of each colour becomes: (256, 3) uint8."""
    low, high = np.log(GAINS)
    gain = np.exp(rng.uniform(low, high) + 0.5 * rng.uniform(low, high, size=3))
    gamma = np.exp(rng.uniform(*np.log(GAMMAS)))
    levels = np.linspace(0.0, 1.0, 256)[:, None] ** gamma * gain
    return np.clip(255.0 * levels, 0.0, 255.0).astype(np.uint8)


def relit(picture: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """A picture (H, W, 3 F) uint8 of F stacked frames under one other light, in a fresh array."""
    height, width, channels = picture.shape
    frames = np.ascontiguousarray(picture).reshape(height, width * channels // 3, 3)
    return np.asarray(cv2.LUT(frames, draw_light(rng)[None])).reshape(picture.shape)


class Relit(SeenOtherwise):
    """Whatever a robot sees, it sees under a light of its own: one for all frames of a stack.

    Pictures are (H, W, 3 F) uint8, or a dict with them as ``image``.
    """

    def __init__(self, env: VecEnv, rng: np.random.Generator) -> None:
        super().__init__(env)
        self._rng = rng

    def see(self, seen: Any) -> Any:
        """Each picture under a light of its own."""
        pictures = np.stack([relit(each, self._rng) for each in parts_of(seen)["image"]])
        return {**seen, "image": pictures} if isinstance(seen, dict) else pictures

    def see_last(self, seen: Any, robot: int) -> Any:  # noqa: ARG002
        """Likewise."""
        picture = relit(parts_of(seen)["image"], self._rng)
        return {**seen, "image": picture} if isinstance(seen, dict) else picture
