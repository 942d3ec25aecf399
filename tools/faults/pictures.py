"""The robot's camera: silent, frozen, slow, garbage; and pictures that are of no use."""

import itertools
import resource
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager

import cv2
import numpy as np

from tools.faults.case import cases, sets
from tools.faults.stage import Stage

RNG = np.random.default_rng(0)
CAMERA = "bench.town.camera"
__all__ = ["CASES", "sets"]


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
    "covered": covered,
    "grains": grains,
    "finger": finger,
    "warped": warped,
    "rolled": rolled,
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


def rate(stage: Stage, hz: float) -> AbstractContextManager[None]:
    """So many pictures a second."""
    return sets(stage, "bench.town.camera_event", period_s=1.0 / hz)


@contextmanager
def no_descriptors(stage: Stage) -> Iterator[None]:
    """The robot may open no file any more, and its camera has hung up."""
    robot = stage.bench.processes["robot"]
    before = resource.prlimit(robot.child.pid, resource.RLIMIT_NOFILE)
    resource.prlimit(robot.child.pid, resource.RLIMIT_NOFILE, (3, before[1]))
    stage.bench.town.camera.hang_up()
    yield
    if robot.alive:
        resource.prlimit(robot.child.pid, resource.RLIMIT_NOFILE, before)


CASES = cases(__name__, "camera", "pictures")
