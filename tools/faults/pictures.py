"""The robot's camera: silent, frozen, slow, garbage; and pictures that are of no use."""

from __future__ import annotations

import itertools
import resource
from collections.abc import Callable

import cv2
import numpy as np

from robot.camera.streams import MAGIC
from tools.faults.case import HOLD_OR_FAULT, Act, Case, change, the_camera
from tools.faults.stage import Stage
from tools.loop.virtual_robot import CAMERA_FPS

FRAME_AGE_S = 0.2
FROZEN_S = 0.6  # five frames more with the same bytes, at the rate of decisions
SLOW_HZ = 3.0

# One bare colour may be taken for a frozen picture first; where a wrong picture has led the robot
# off its path first, that is as good.
BLIND = (0.5, "lens covered|same picture", ("FAULT",))
STILL = (1.5, "has not moved|left its planned path", HOLD_OR_FAULT)
WRONG = (2.0, "road lies|left its planned path", HOLD_OR_FAULT)
LIKE_A_BEND = (6.0, *WRONG[1:])
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
    return small.repeat(8, axis=0).repeat(8, axis=1)[: len(picture)]


def finger(picture: np.ndarray) -> np.ndarray:
    """Light through a finger."""
    y, x = np.mgrid[: picture.shape[0], : picture.shape[1]]
    light = np.exp(-(((x - 60) / 90.0) ** 2) - ((y - 70) / 70.0) ** 2)[..., None]
    return noisy(light * (110.0, 18.0, 12.0) + (40.0, 5.0, 5.0), 4.0)


def warped(*matrix: float) -> Spoil:
    """Every pixel moved by an affine map (2, 3), round the edges."""
    way = np.reshape(matrix, (2, 3)).astype(float)
    return lambda p: np.asarray(cv2.warpAffine(p, way, (160, 120), borderMode=cv2.BORDER_WRAP))


def rolled(picture: np.ndarray) -> np.ndarray:
    """By 30 degrees about the middle."""
    turn = cv2.getRotationMatrix2D((79.5, 59.5), 30.0, 1.0)
    return np.asarray(cv2.warpAffine(picture, turn, picture.shape[1::-1]))


WELL = change(the_camera, spoil=None)


def spoiled(name: str, what: str, wrong: Spoil, met: tuple[float, str, tuple[str, ...]]) -> Case:
    """Every picture spoiled until mended."""
    return Case(name, what, change(the_camera, spoil=wrong), *met, heal=WELL)


def _held(stage: Stage) -> None:
    """The picture of now again and again, through a sensor's noise."""
    first = stage.bench.town.world.see()
    the_camera(stage).spoil = lambda _: noisy(first, 6.0)


def shortly(name: str, what: str, wrong: Spoil, pictures: int) -> Case:
    """So many pictures spoiled, the rest as they come."""

    def inject(stage: Stage) -> None:
        spoils = itertools.chain([True] * pictures, itertools.repeat(False))
        the_camera(stage).spoil = lambda picture: wrong(picture) if next(spoils) else picture

    return Case(name, what, inject, states=(), heal=WELL)


PICTURES = (
    spoiled("black", "lens covered: black", covered(0), BLIND),
    spoiled("black, noise", "lens covered: noise of 12 levels", covered(0, 12), BLIND),
    spoiled("white", "a lamp before the lens: white", covered(255), BLIND),
    spoiled("white, noise", "white with noise of 12 levels", covered(255, 12), BLIND),
    spoiled("grey", "nothing but grey", covered(128), BLIND),
    spoiled("noise", "nothing but noise, each pixel", covered(128, 90), BLIND),
    spoiled("coarse noise", "nothing but noise in grains of 8 px", grains, BLIND),
    spoiled("finger", "a finger before the lens: dark red", finger, BLIND),
    spoiled("mirrored", "left and right exchanged", lambda p: p[:, ::-1], WRONG),
    spoiled("upside down", "turned by 180 degrees", lambda p: p[::-1, ::-1], WRONG),
    spoiled("sheared", "each row a pixel farther to the right", warped(1, 1, 0, 0, 1, 0), WRONG),
    spoiled("rolled", "turned by 30 degrees: a camera came loose", rolled, LIKE_A_BEND),
    spoiled(
        "shifted", "a quarter of its width to the right", lambda p: np.roll(p, 40, 1), LIKE_A_BEND
    ),
    Case(
        *("held", "the same picture with noise of 6 levels", _held, *STILL),
        heal=WELL,
    ),
    shortly("glare", "white for 0.2 s: it must drive on", covered(255), 3),
    shortly("one odd picture", "noise in one picture: it must drive on", covered(128, 90), 1),
)


def _rate(hz: float) -> Act:
    return change(lambda stage: stage.bench.town.camera_event, period_s=1.0 / hz)


def _may_open(stage: Stage, most: int | None = None) -> None:
    """The robot may have so many files open, or as many as it can."""
    robot = stage.bench.processes["robot"]
    if robot.alive:
        _, limit = resource.prlimit(robot.child.pid, resource.RLIMIT_NOFILE)
        soft = limit if most is None else most
        resource.prlimit(robot.child.pid, resource.RLIMIT_NOFILE, (soft, limit))


def _no_descriptors(stage: Stage) -> None:
    _may_open(stage, 3)
    the_camera(stage).hang_up()


def halved(picture: np.ndarray) -> np.ndarray:
    """Every second row and column."""
    return picture[::2, ::2]


def _frozen(stage: Stage) -> None:
    frozen = stage.bench.town.world.see()
    the_camera(stage).spoil = lambda _: frozen


CAMERA = (
    Case(
        *("stops", "no picture any more", change(the_camera, silent=True), FRAME_AGE_S, "frame"),
        heal=change(the_camera, silent=False),
    ),
    Case(
        *("freezes", "new pictures, each with the bytes of the last", _frozen),
        *(FROZEN_S, "same picture"),
        heal=WELL,
    ),
    Case(
        *("slows", f"{SLOW_HZ:g} pictures a second", _rate(SLOW_HZ), FRAME_AGE_S, "frame"),
        heal=_rate(CAMERA_FPS),
    ),
    spoiled("wrong size", "80 x 60 px", halved, (FRAME_AGE_S, "frame", ("FAULT",))),
    Case(
        *("garbage", "bytes that are none", change(the_camera, magic=b"\x00\xff\x17\x80")),
        *(FRAME_AGE_S, "frame"),
        heal=change(the_camera, magic=MAGIC),
    ),
    shortly("one odd picture", "80 x 60 px, once", halved, 1),
    Case(
        *("no descriptors", "and the camera must be opened anew", _no_descriptors),
        *(FRAME_AGE_S, "frame|Too many open files"),
        heal=_may_open,
        drives_again=True,
    ),
)
CASES = {"camera": CAMERA, "pictures": PICTURES}
