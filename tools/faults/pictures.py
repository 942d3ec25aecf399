"""Pictures that are of no use: a covered lens, noise, a picture turned, torn or held."""

from __future__ import annotations

from collections.abc import Callable

import cv2
import numpy as np

from tools.faults.case import Act, Case
from tools.faults.stage import Stage

Spoil = Callable[[np.ndarray], np.ndarray]
BLIND_S, STILL_S, WRONG_S = 0.5, 1.5, 2.0
RNG = np.random.default_rng(0)


def _noisy(picture: np.ndarray, deviation: float) -> np.ndarray:
    noise = deviation * RNG.standard_normal(picture.shape)
    return np.clip(picture + noise, 0, 255).astype(np.uint8)


def _covered(level: float, deviation: float = 0.0) -> Spoil:
    return lambda picture: _noisy(np.full(picture.shape, level), deviation)


def _grains(picture: np.ndarray) -> np.ndarray:
    small = _noisy(np.full((15, 20, 3), 128.0), 80.0)
    return np.ascontiguousarray(small.repeat(8, axis=0).repeat(8, axis=1)[: len(picture)])


def _finger(picture: np.ndarray) -> np.ndarray:
    y, x = np.mgrid[: picture.shape[0], : picture.shape[1]]
    light = np.exp(-(((x - 60) / 90.0) ** 2) - ((y - 70) / 70.0) ** 2)[..., None]
    return _noisy(light * (110.0, 18.0, 12.0) + (40.0, 5.0, 5.0), 4.0)


def _half(picture: np.ndarray) -> np.ndarray:
    return np.concatenate((picture[:, :80], np.zeros_like(picture[:, 80:])), axis=1)


def _sheared(picture: np.ndarray) -> np.ndarray:
    """Each row begins a pixel later than the one above: a line length misread by one."""
    return np.stack([np.roll(row, number, axis=0) for number, row in enumerate(picture)])


def _shifted(picture: np.ndarray) -> np.ndarray:
    return np.roll(picture, picture.shape[1] // 4, axis=1)


def _rolled(degrees: float) -> Spoil:
    turn = cv2.getRotationMatrix2D((79.5, 59.5), degrees, 1.0)
    return lambda picture: np.asarray(cv2.warpAffine(picture, turn, picture.shape[1::-1]))


class _Held:
    """The first picture again and again, through a sensor's noise."""

    def __init__(self, deviation: float) -> None:
        self._deviation = deviation
        self._first: np.ndarray | None = None

    def __call__(self, picture: np.ndarray) -> np.ndarray:
        self._first = picture if self._first is None else self._first
        return _noisy(self._first, self._deviation)


class _Moment:
    """So many pictures spoiled, the rest as they come."""

    def __init__(self, spoil: Spoil, pictures: int) -> None:
        self._spoil, self._left = spoil, pictures

    def __call__(self, picture: np.ndarray) -> np.ndarray:
        self._left -= 1
        return self._spoil(picture) if self._left >= 0 else picture


def _spoils(make: Callable[[], Spoil]) -> Act:
    def inject(stage: Stage) -> None:
        stage.bench.town.camera.spoil = make()

    return inject


def _heal(stage: Stage) -> None:
    stage.bench.town.camera.spoil = None


def _stops(name: str, what: str, spoil: Spoil, threshold_s: float, says: str) -> Case:
    return Case(name, what, _spoils(lambda: spoil), threshold_s, says=says, heal=_heal)


def _blind(name: str, what: str, spoil: Spoil) -> Case:
    return _stops(name, what, spoil, BLIND_S, "lens covered|same picture")


def _wrong(name: str, what: str, spoil: Spoil) -> Case:
    says = "road lies|left its planned path"  # where it leaves the path first, that is as good
    states = ("FAULT", "HOLD")
    return Case(name, what, _spoils(lambda: spoil), WRONG_S, states, says, heal=_heal)


def _drives(name: str, what: str, spoil: Spoil, pictures: int) -> Case:
    make = _spoils(lambda: _Moment(spoil, pictures))
    return Case(name, what, make, states=(), heal=_heal)


CASES = (
    _blind("black", "lens covered: black", _covered(0)),
    _blind("black, noise", "lens covered: black with noise of 12 levels", _covered(0, 12)),
    _blind("white", "lens against a lamp: white", _covered(255)),
    _blind("white, noise", "white with noise of 12 levels", _covered(255, 12)),
    _blind("grey", "nothing but grey", _covered(128)),
    _blind("noise", "nothing but noise, pixel by pixel", _covered(128, 90)),
    _blind("coarse noise", "nothing but noise in grains of 8 pixels", _grains),
    _blind("finger", "a finger before the lens: dark red, blurred", _finger),
    _wrong("mirrored", "left and right exchanged", lambda picture: picture[:, ::-1]),
    _wrong("upside down", "turned by 180 degrees", lambda picture: picture[::-1, ::-1]),
    _wrong("sheared", "each row a pixel farther to the right", _sheared),
    _wrong("rolled", "turned by 30 degrees, as a camera that came loose", _rolled(30.0)),
    _wrong("shifted", "a quarter of its width to the right", _shifted),
    Case(
        *("held, noise", "the same picture again and again, with noise of 6 levels"),
        *(_spoils(lambda: _Held(6.0)), STILL_S),
        says="has not moved",
        heal=_heal,
    ),
    _drives("glare", "white for 0.2 s: it must drive on", _covered(255), 3),
    _drives("one odd picture", "noise in one picture: it must drive on", _covered(128, 90), 1),
)
