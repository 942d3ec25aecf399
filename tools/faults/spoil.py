"""What can happen to a camera's pictures, as functions of a picture (120, 160, 3) uint8 RGB."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import cv2
import numpy as np

Spoil = Callable[[np.ndarray], np.ndarray]
BLIND_S, STILL_S, WRONG_S = 0.5, 1.5, 2.0  # until the robot must doubt such pictures
LIKE_A_BEND_S = 6.0  # what is most like a bend
RNG = np.random.default_rng(0)


class Spoiled(NamedTuple):
    """A way to spoil pictures; ``make`` gives a fresh one."""

    what: str
    make: Callable[[], Spoil]
    threshold_s: float


def noisy(picture: np.ndarray, deviation: float) -> np.ndarray:
    """With a sensor's noise, new in every picture."""
    noise = deviation * RNG.standard_normal(picture.shape)
    return np.clip(picture + noise, 0, 255).astype(np.uint8)


def covered(level: float, deviation: float = 0.0) -> Spoil:
    """One grey level with noise."""
    return lambda picture: noisy(np.full(picture.shape, level), deviation)


def _grains(picture: np.ndarray) -> np.ndarray:
    small = noisy(np.full((15, 20, 3), 128.0), 80.0)
    return np.ascontiguousarray(small.repeat(8, axis=0).repeat(8, axis=1)[: len(picture)])


def _finger(picture: np.ndarray) -> np.ndarray:
    y, x = np.mgrid[: picture.shape[0], : picture.shape[1]]
    light = np.exp(-(((x - 60) / 90.0) ** 2) - ((y - 70) / 70.0) ** 2)[..., None]
    return noisy(light * (110.0, 18.0, 12.0) + (40.0, 5.0, 5.0), 4.0)


def _half(picture: np.ndarray) -> np.ndarray:
    return np.concatenate((picture[:, :80], np.zeros_like(picture[:, 80:])), axis=1)


def _mirrored(picture: np.ndarray) -> np.ndarray:
    return np.ascontiguousarray(picture[:, ::-1])


def _upside_down(picture: np.ndarray) -> np.ndarray:
    return np.ascontiguousarray(picture[::-1, ::-1])


def _sheared(picture: np.ndarray) -> np.ndarray:
    return np.stack([np.roll(row, number, axis=0) for number, row in enumerate(picture)])


def _shifted(picture: np.ndarray) -> np.ndarray:
    return np.roll(picture, picture.shape[1] // 4, axis=1)


def _rolled(picture: np.ndarray) -> np.ndarray:
    turn = cv2.getRotationMatrix2D((79.5, 59.5), 30.0, 1.0)
    return np.asarray(cv2.warpAffine(picture, turn, picture.shape[1::-1]))


class _Held:
    """The first picture again and again, through a sensor's noise."""

    def __init__(self) -> None:
        self._first: np.ndarray | None = None

    def __call__(self, picture: np.ndarray) -> np.ndarray:
        self._first = picture.copy() if self._first is None else self._first
        return noisy(self._first, 6.0)


class Moment:
    """So many pictures spoiled, the rest as they come."""

    def __init__(self, spoil: Spoil, pictures: int) -> None:
        self._spoil, self._left = spoil, pictures

    def __call__(self, picture: np.ndarray) -> np.ndarray:
        """Spoil it, or not any more."""
        self._left -= 1
        return self._spoil(picture) if self._left >= 0 else picture


SPOILED: dict[str, Spoiled] = {
    "black": Spoiled("lens covered: black", lambda: covered(0), BLIND_S),
    "black, noise": Spoiled("lens covered: noise of 12 levels", lambda: covered(0, 12), BLIND_S),
    "white": Spoiled("a lamp before the lens: white", lambda: covered(255), BLIND_S),
    "white, noise": Spoiled("white with noise of 12 levels", lambda: covered(255, 12), BLIND_S),
    "grey": Spoiled("nothing but grey", lambda: covered(128), BLIND_S),
    "noise": Spoiled("nothing but noise, each pixel", lambda: covered(128, 90), BLIND_S),
    "coarse noise": Spoiled("nothing but noise in grains of 8 px", lambda: _grains, BLIND_S),
    "finger": Spoiled("a finger before the lens: dark red", lambda: _finger, BLIND_S),
    "mirrored": Spoiled("left and right exchanged", lambda: _mirrored, WRONG_S),
    "upside down": Spoiled("turned by 180 degrees", lambda: _upside_down, WRONG_S),
    "sheared": Spoiled("each row a pixel farther to the right", lambda: _sheared, WRONG_S),
    "rolled": Spoiled("turned by 30 degrees: a camera came loose", lambda: _rolled, LIKE_A_BEND_S),
    "shifted": Spoiled("a quarter of its width to the right", lambda: _shifted, LIKE_A_BEND_S),
    "held": Spoiled("the same picture with noise of 6 levels", _Held, STILL_S),
    "half covered": Spoiled("its right half black", lambda: _half, WRONG_S),
}
