"""A recorded drive in pictures: as stacks for a policy, split by time, and how they turn.

The upper part of a picture is far away. When the camera turns it shifts sideways, by the same way
at every distance, and hardly otherwise (phase correlation, Kuglin and Hines 1975). Recorded angles
must agree with that, some pictures later, for wheels and camera are late; where they do not, they
are of another sign, of another drive, or of nothing.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

import cv2
import numpy as np

from robot.camera.files import read_picture
from robot.camera.source import fit_to_frame
from robot.errors import ConfigError
from trainer.experiments.records import Drive, turns

See = Callable[[np.ndarray], np.ndarray]  # frames (N, 120, 160, 3) -> pictures (N, H, W, 3), uint8
STACK = 4  # paper B: four consecutive frames
TRAINING_SHARE = 0.6
GAP_FRAMES = 20  # between training and test: neighbours look alike
_FAR = slice(0, 40), slice(30, 130)  # rows and columns of a frame, above and around the road
_SMOOTHED = 5  # pictures
_LATEST = 20  # pictures by which a camera may be late
_AGAINST = -0.5  # correlation at which angles have the wrong sign for sure


class Stacks(NamedTuple):
    """Some moments of a drive."""

    pictures: np.ndarray  # (M, H, W, 3) uint8 RGB, all pictures of the drive
    last: np.ndarray  # (N,) index of each moment's newest picture
    turns: np.ndarray  # (N,) int64 values of `Turn`: what the person did
    every: int = 1  # of how many pictures one is in the stack

    def stacked(self, chosen: np.ndarray | slice = slice(None)) -> np.ndarray:
        """(N, H, W, 3 * STACK) uint8 of the chosen moments, the oldest picture first."""
        last = self.last[chosen]
        parts = [self.pictures[last - back * self.every] for back in reversed(range(STACK))]
        return np.concatenate(parts, axis=-1)


def frames_of(drive: Drive) -> np.ndarray:
    """(N, 120, 160, 3) uint8 RGB; of pictures that are not 4:3 the middle is taken.

    Raises:
        ConfigError: a file is no picture.
    """
    return np.stack([fit_to_frame(read_picture(file)) for file in drive.files])


def make_stacks(drive: Drive, frames: np.ndarray, see: See, every: int = 1) -> Stacks:
    """All moments of a drive that have the pictures of a stack before them, one of ``every``.

    Raises:
        ConfigError: the drive is too short.
    """
    first = (STACK - 1) * every
    if len(drive) <= first:
        raise ConfigError(f"drive: expected more than {first} pictures, got {len(drive)}")
    last = np.arange(first, len(drive))
    return Stacks(see(frames), last, turns(drive.steering_deg)[last], every)


def split_by_time(stacks: Stacks) -> tuple[Stacks, Stacks]:
    """(training, test): the first 60 % of the drive, and what comes a gap of 20 frames later.

    No picture is in both. A random split would test on the neighbours of what was trained on.

    Raises:
        ConfigError: nothing would be left to test on.
    """
    end = round(TRAINING_SHARE * len(stacks.pictures))
    training = stacks.last < end
    test = stacks.last - (STACK - 1) * stacks.every >= end + GAP_FRAMES
    if not training.any() or not test.any():
        raise ConfigError(
            f"drive: expected enough pictures to train and to test on, got {len(stacks.pictures)}"
        )
    parts = [stacks._replace(last=stacks.last[m], turns=stacks.turns[m]) for m in (training, test)]
    return parts[0], parts[1]


@dataclass(frozen=True)
class Turning:
    """How angles go with what the pictures show."""

    correlation: float  # of angle and turning, where it is greatest; 0 for angles all alike
    late_frames: int  # pictures from an angle to the turning that agrees with it best


def shifts_px(frames: np.ndarray) -> np.ndarray:
    """(N - 1,) by how much the far world moves to the left between frames: to the right we turn."""
    rows, columns = _FAR
    shape = columns.stop - columns.start, rows.stop - rows.start
    window = cv2.createHanningWindow(shape, cv2.CV_32F)
    far = [cv2.cvtColor(each, cv2.COLOR_RGB2GRAY)[_FAR].astype(np.float32) for each in frames]
    return np.array([-cv2.phaseCorrelate(a, b, window)[0][0] for a, b in pairwise(far)])


def turning(steering_deg: np.ndarray, moved_px: np.ndarray) -> Turning:
    """How the angles (N,) of a drive go with what its pictures (N - 1,) show.

    Raises:
        ConfigError: they go against each other.
    """
    smooth = np.convolve(moved_px, np.full(_SMOOTHED, 1.0 / _SMOOTHED), mode="same")
    best = Turning(0.0, 0)
    for late in range(min(_LATEST, len(smooth) // 2)):
        angle, seen = steering_deg[: len(smooth) - late], smooth[late:]
        if angle.std() > 0.0 and seen.std() > 0.0:
            correlation = float(np.corrcoef(angle, seen)[0, 1])
            if abs(correlation) > abs(best.correlation):
                best = Turning(correlation, late)
    if best.correlation < _AGAINST:
        raise ConfigError(
            "angles: expected positive ones where the pictures turn right, got a correlation of "
            f"{best.correlation:.2f}; change the sign of the angles"
        )
    return best
