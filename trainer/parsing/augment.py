"""What a batch of labelled frames goes through before a parser learns from it."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np

from trainer.parsing.labelled import Labelled

CROPS = (0.6, 1.0)  # share of the frame's height and width
GAINS = (0.7, 1.4)  # of brightness, and of each colour by the square root of it
GAMMAS = (0.7, 1.4)


def draw_batch(
    sources: Sequence[Labelled], count: int, rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray]:
    """``count`` frames (N, H, W, 3) and labels (N, H, W), cropped, mirrored and relit at random.

    Every source is drawn from as often as every other, however many frames it has.
    """
    shape = sources[0].truth.shape[1:]
    frames, truth = np.empty((count, *shape, 3), np.uint8), np.empty((count, *shape), np.uint8)
    for out in range(count):
        source = sources[int(rng.integers(len(sources)))]
        i = int(rng.integers(len(source)))
        window, mirrored = _window(shape, rng), bool(rng.integers(2))
        frames[out] = relit(_cut(source.frames[i], window, mirrored, cv2.INTER_LINEAR), rng)
        truth[out] = _cut(source.truth[i], window, mirrored, cv2.INTER_NEAREST)
    return frames, truth


def relit(frame: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """The frame (H, W, 3) under another light: gain, colour cast and gamma, uint8."""
    low, high = np.log(GAINS)
    gain = np.exp(rng.uniform(low, high) + 0.5 * rng.uniform(low, high, size=3))
    low, high = np.log(GAMMAS)
    gamma = np.exp(rng.uniform(low, high))
    levels = np.linspace(0.0, 1.0, 256)[:, None] ** gamma * gain
    table = np.clip(255.0 * levels, 0.0, 255.0).astype(np.uint8)
    return np.stack([table[frame[..., c], c] for c in range(3)], axis=-1)


def _window(shape: tuple[int, ...], rng: np.random.Generator) -> tuple[slice, slice]:
    share = rng.uniform(*CROPS)
    sizes = [max(1, round(share * full)) for full in shape]
    starts = [int(rng.integers(full - size + 1)) for full, size in zip(shape, sizes, strict=True)]
    top, left = (slice(a, a + size) for a, size in zip(starts, sizes, strict=True))
    return top, left


def _cut(
    picture: np.ndarray, window: tuple[slice, slice], mirrored: bool, interpolation: int
) -> np.ndarray:
    size = picture.shape[1], picture.shape[0]
    part = cv2.resize(picture[window], size, interpolation=interpolation)
    return np.asarray(part)[:, ::-1] if mirrored else np.asarray(part)
