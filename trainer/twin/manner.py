"""How a person steers: pure pursuit of the lane that sight sees, in a manner of their own.

Two numbers tell it, a look-ahead and a gain, in which a car of another size or lens is, too. A
network that learned some hundred pictures knows left bends only if it was shown some; a manner
tells of both sides, and of pictures that nobody took.
"""

import math
from typing import NamedTuple

import numpy as np

from robot.contract import FIVE_ACTIONS
from robot.vision.sight import OnnxSight
from trainer.twin.examples import Examples, shares_of

_AHEAD_M = np.geomspace(0.12, 1.2, 25)  # asked
_EXPLAINED = 0.25  # of the square of a person's curvature, by their manner, at least


class Manner(NamedTuple):
    """See the module."""

    sight: OnnxSight
    ahead_m: float
    gain: float

    def shares(self, images: np.ndarray, otherwise: np.ndarray) -> np.ndarray:
        """(N, A) of the five actions at pictures (N, H, W, 3); ``otherwise`` where no lane is."""
        bends_pm = self.gain * _pure_pm(_lanes(self.sight, images), self.ahead_m)
        known = np.isfinite(bends_pm)
        found = otherwise.copy()
        found[known] = shares_of(bends_pm[known], FIVE_ACTIONS)
        return found

    def smoothed(self, person: Examples) -> Examples:
        """What they did is half by chance, so half is told as they usually would; no correction."""
        usual, own = self.shares(person.images, person.shares), person.weights[:, None] > 1.0
        half = 0.5 * (person.shares + usual)
        return person._replace(shares=np.where(own, person.shares, half))


def manner_of(person: Examples, sight: OnnxSight) -> Manner | None:
    """That of what a person did; None where sight does not tell why they steered."""
    if person.images.shape[1:] != sight.contract.image.shape or not len(person.images):
        return None
    lanes = _lanes(sight, person.images)
    known = np.isfinite(lanes[:, 0])
    lanes, did_pm = lanes[known], person.bends_pm[known]
    alike, found = math.sqrt(_EXPLAINED), None
    for ahead_m in _AHEAD_M.tolist():
        pure_pm = _pure_pm(lanes, ahead_m)
        both = math.sqrt(float(pure_pm @ pure_pm) * float(did_pm @ did_pm))
        if both and float(pure_pm @ did_pm) / both > alike:
            alike = float(pure_pm @ did_pm) / both
            found = Manner(sight, ahead_m, float(did_pm @ did_pm) / both)
    return found


def _lanes(sight: OnnxSight, images: np.ndarray) -> np.ndarray:
    """(N, 3) offset, heading and curvature; NaN where there is no lane to be in."""
    seen = sight(images)
    return np.where(seen.in_lane[:, None], seen.figures[:, :3], np.nan)


def _pure_pm(lanes: np.ndarray, ahead_m: float) -> np.ndarray:
    """(N,) curvature that leads to the middle of lanes (N, 3) at this distance."""
    offset_m, heading_rad, curvature_pm = lanes.T
    return np.asarray(curvature_pm - 2.0 * (heading_rad + offset_m / ahead_m) / ahead_m)
