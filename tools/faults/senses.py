"""What the robot is told wrongly: pictures, and poses and wheels that tell two ways.

The camera is silent, frozen, slow, or its pictures are of no use; poses are none, late, in the
wrong order, or jump.
"""

import itertools
import math
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager

import cv2
import numpy as np

from robot.geometry import Pose, wrap_angle
from sim_pybullet.virtual.world import PHYSICS_DT_S
from tools.faults.case import sets
from tools.faults.stage import Stage
from tools.loop.timekeeper import BenchError

RNG = np.random.default_rng(0)
CAMERA = "bench.town.camera"
BENT_RAD = 0.2  # no robot turns so far on a straight
TURN_RADPS = math.radians(3.0)
WIDTH_M = 2.2  # of the arena
NOISE = 3.0  # of the overhead sensor, grey levels


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


replaced = Stage.replace_localizer


def _moved(pose: Pose, ahead_m: float, left_m: float) -> Pose:
    x_m, y_m = (float(v) for v in pose.to_world(np.array((ahead_m, left_m))))
    return pose._replace(x_m=x_m, y_m=y_m)


def drifting(pose: Pose, t_s: float, first: Pose, ahead_mps: float, left_mps: float) -> Pose:
    """By the directions of the beginning."""
    way = first._replace(x_m=pose.x_m, y_m=pose.y_m)
    return _moved(way, ahead_mps * t_s, left_mps * t_s)._replace(heading_rad=pose.heading_rad)


# Of a true pose, the time since the lie began [s], the true pose of then, and what a row tells.
LIES: dict[str, Callable[..., Pose]] = {
    "drifting": drifting,
    "east": lambda pose, *_: pose._replace(x_m=pose.x_m + 1.0),
    "turning": lambda p, t_s, _: p._replace(heading_rad=p.heading_rad + TURN_RADPS * t_s),
    "stands_beside": lambda _p, _t, first: _moved(first, 0.0, 0.08),
    "beside": lambda pose, _t, _f, *by_m: _moved(pose, *by_m),
    "mirrored": lambda p, *_: Pose(WIDTH_M - p.x_m, p.y_m, math.pi - p.heading_rad),
    "scaled": lambda p, *_: p._replace(x_m=1.1 * p.x_m, y_m=1.1 * p.y_m),
}


def lies(stage: Stage, how: str, *told: float) -> None:
    """The stand-in told true poses until now."""
    stage.stand_in.lies(lambda *true: LIES[how](*true, *told))


def overhead(stage: Stage, how: str) -> AbstractContextManager[None]:
    """The overhead camera shows the picture of now, changed a little."""
    frozen, rng = stage.bench.town.see_above(), stage.rng

    def see() -> np.ndarray:
        if how == "noisy":
            return noisy(frozen, NOISE)
        picture = frozen.copy()
        if how == "flickering":
            picture[300, 400] = rng.integers(0, 256, 3)
        return picture

    return sets(stage, "bench.town.overhead", see=see)


@contextmanager
def held(stage: Stage, aside_m: float = 0.0, turns: bool = False) -> Iterator[None]:
    """Hands keep a robot where it is, or a little aside, whatever its wheels do."""
    world = stage.bench.town.world
    x_m, y_m, heading_rad = _moved(world.pose, 0.0, aside_m)

    def keep() -> None:
        world.place(Pose(x_m, y_m, world.pose.heading_rad if turns else heading_rad))

    event = stage.bench.time.every(PHYSICS_DT_S, keep)
    yield
    stage.bench.time.forget(event)


def to_a_bend(stage: Stage) -> None:
    """On to where the mission's first bend begins."""
    for _ in range(200):
        turned = wrap_angle(stage.bench.town.pose.heading_rad - stage.start.heading_rad)
        if abs(float(turned)) > BENT_RAD:
            return
        stage.run(0.1)
    raise BenchError("expected a bend within 20 s, the robot drove straight on")
