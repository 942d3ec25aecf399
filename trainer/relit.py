"""Pictures under another light: gain, colour cast and gamma, drawn at random.

Augmentation of what a policy sees while it learns, after Laskin et al. 2020 ("Reinforcement
Learning with Augmented Data"). It helps where classes are painted, too (docs/lab-log.md).
"""

import cv2
import numpy as np

GAINS = (0.7, 1.4)  # of brightness, and of each colour by the square root of it
GAMMAS = (0.7, 1.4)
_LEVELS = np.linspace(0.0, 1.0, 256)[:, None]


def draw_light(rng: np.random.Generator) -> np.ndarray:
    """What each grey level of each colour becomes: (256, 3) uint8."""
    low, high = np.log(GAINS)
    gain = np.exp(rng.uniform(low, high) + 0.5 * rng.uniform(low, high, size=3))
    levels = _LEVELS ** np.exp(rng.uniform(*np.log(GAMMAS))) * gain
    return np.clip(255.0 * levels, 0.0, 255.0).astype(np.uint8)


def relit(picture: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """A picture (H, W, 3 F) uint8 of F stacked frames under one other light, in a fresh array."""
    height, width, channels = picture.shape
    frames = np.ascontiguousarray(picture).reshape(height, width * channels // 3, 3)
    return np.asarray(cv2.LUT(frames, draw_light(rng)[None])).reshape(picture.shape)
