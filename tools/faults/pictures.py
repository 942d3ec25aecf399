"""The robot's camera: silent, frozen, slow, garbage; and pictures that are of no use."""

import itertools
from collections.abc import Callable
from contextlib import AbstractContextManager

import cv2
import numpy as np

from tools.faults.case import sets
from tools.faults.stage import Stage

RNG = np.random.default_rng(0)
CAMERA = "bench.town.camera"


def noisy(picture: np.ndarray, deviation: float) -> np.ndarray:
    """With a sensor's noise, new in every picture."""
    noise = deviation * RNG.standard_normal(picture.shape)
    return np.clip(picture + noise, 0, 255).astype(np.uint8)


def covered(picture: np.ndarray, level: float, deviation: float = 0.0) -> np.ndarray:
    """One grey level with noise."""
    return noisy(np.full(picture.shape, float(level)), deviation)


def grains(picture: np.ndarray) -> np.ndarray:
    """Noise in grains of 8 px."""
    small = noisy(np.full((15, 20, 3), 128.0), 80.0)
    return small.repeat(8, axis=0).repeat(8, axis=1)[: len(picture)]


def finger(picture: np.ndarray) -> np.ndarray:
    """Light through a finger."""
    y, x = np.mgrid[: picture.shape[0], : picture.shape[1]]
    light = np.exp(-(((x - 60) / 90.0) ** 2) - ((y - 70) / 70.0) ** 2)[..., None]
    return noisy(light * (110.0, 18.0, 12.0) + (40.0, 5.0, 5.0), 4.0)


def warped(picture: np.ndarray, *matrix: float) -> np.ndarray:
    """Every pixel moved by an affine map (2, 3), round the edges."""
    way = np.reshape(matrix, (2, 3)).astype(float)
    return np.asarray(cv2.warpAffine(picture, way, (160, 120), borderMode=cv2.BORDER_WRAP))


def rolled(picture: np.ndarray) -> np.ndarray:
    """By 30 degrees about the middle."""
    turn = cv2.getRotationMatrix2D((79.5, 59.5), 30.0, 1.0)
    return np.asarray(cv2.warpAffine(picture, turn, picture.shape[1::-1]))


SPOILS: dict[str, Callable[..., np.ndarray]] = {
    **{spoil.__name__: spoil for spoil in (covered, grains, finger, warped, rolled)},
    "mirrored": lambda picture: picture[:, ::-1],
    "upside_down": lambda picture: picture[::-1, ::-1],
    "shifted": lambda picture: np.roll(picture, 40, 1),
    "halved": lambda picture: picture[::2, ::2],
}


def spoiled(stage: Stage, how: str, *told: float) -> AbstractContextManager[None]:
    """Every picture, until mended."""
    return sets(stage, CAMERA, spoil=lambda picture: SPOILS[how](picture, *told))


def shortly(stage: Stage, pictures: int, how: str, *told: float) -> AbstractContextManager[None]:
    """So many pictures spoiled, the rest as they come."""
    spoils = itertools.chain([True] * pictures, itertools.repeat(False))
    return sets(stage, CAMERA, spoil=lambda p: SPOILS[how](p, *told) if next(spoils) else p)


def again(stage: Stage, deviation: float) -> AbstractContextManager[None]:
    """The picture of now again and again, through a sensor's noise if there is any."""
    now = stage.bench.town.world.see()
    return sets(stage, CAMERA, spoil=lambda _: noisy(now, deviation) if deviation else now)
