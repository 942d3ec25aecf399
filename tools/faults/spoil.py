"""What can happen to a camera's pictures, as functions of a picture (120, 160, 3) uint8 RGB."""

from __future__ import annotations

import itertools
from collections.abc import Callable

import cv2
import numpy as np

Spoil = Callable[[np.ndarray], np.ndarray]
RNG = np.random.default_rng(0)


def noisy(picture: np.ndarray, deviation: float) -> np.ndarray:
    """With a sensor's noise, new in every picture."""
    noise = deviation * RNG.standard_normal(picture.shape)
    return np.clip(picture + noise, 0, 255).astype(np.uint8)


def covered(level: float, deviation: float = 0.0) -> Spoil:
    """One grey level with noise."""
    return lambda picture: noisy(np.full(picture.shape, level), deviation)


def grains(picture: np.ndarray) -> np.ndarray:
    """Noise in grains of 8 px."""
    small = noisy(np.full((15, 20, 3), 128.0), 80.0)
    return np.ascontiguousarray(small.repeat(8, axis=0).repeat(8, axis=1)[: len(picture)])


def finger(picture: np.ndarray) -> np.ndarray:
    """Light through a finger."""
    y, x = np.mgrid[: picture.shape[0], : picture.shape[1]]
    light = np.exp(-(((x - 60) / 90.0) ** 2) - ((y - 70) / 70.0) ** 2)[..., None]
    return noisy(light * (110.0, 18.0, 12.0) + (40.0, 5.0, 5.0), 4.0)


def mirrored(picture: np.ndarray) -> np.ndarray:
    """Left and right exchanged."""
    return np.ascontiguousarray(picture[:, ::-1])


def upside_down(picture: np.ndarray) -> np.ndarray:
    """Turned by 180 degrees."""
    return np.ascontiguousarray(picture[::-1, ::-1])


def sheared(picture: np.ndarray) -> np.ndarray:
    """Read one clock late in every line."""
    return np.stack([np.roll(row, number, axis=0) for number, row in enumerate(picture)])


def shifted(picture: np.ndarray) -> np.ndarray:
    """By a quarter of the width."""
    return np.roll(picture, picture.shape[1] // 4, axis=1)


def rolled(picture: np.ndarray) -> np.ndarray:
    """By 30 degrees about the middle."""
    turn = cv2.getRotationMatrix2D((79.5, 59.5), 30.0, 1.0)
    return np.asarray(cv2.warpAffine(picture, turn, picture.shape[1::-1]))


def held() -> Spoil:
    """The first picture again and again, through a sensor's noise."""
    first: list[np.ndarray] = []

    def again(picture: np.ndarray) -> np.ndarray:
        first[:] = first or [picture.copy()]
        return noisy(first[0], 6.0)

    return again


def shortly(spoil: Spoil, pictures: int) -> Spoil:
    """So many pictures spoiled, the rest as they come."""
    spoils = itertools.chain([True] * pictures, itertools.repeat(False))
    return lambda picture: spoil(picture) if next(spoils) else picture
