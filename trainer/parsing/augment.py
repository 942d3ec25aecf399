"""What a batch of labelled frames goes through before a parser learns from it."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np

from trainer.parsing.labelled import Labelled
from trainer.relit import relit

CROPS = (0.6, 1.0)  # share of the frame's height and width


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
