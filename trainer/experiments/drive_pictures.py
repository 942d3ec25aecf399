"""A recorded drive in pictures: as stacks for a policy, split by time, and how they turn.

The upper part of a picture is far away. When the camera turns it shifts sideways, by the same way
at every distance, and hardly otherwise (phase correlation, Kuglin and Hines 1975). Recorded angles
must agree with that, some pictures later, for wheels and camera are late; where they do not, they
are of another sign, of another drive, or of nothing.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import cv2
import numpy as np

from robot.camera.replay import read_picture
from robot.camera.source import fit_to_frame
from robot.contract import ImageSpec
from robot.errors import ConfigError
from robot.inference.preprocess import preprocess_batch
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

    @property
    def reach(self) -> int:
        """How many pictures before its newest one a stack begins."""
        return (STACK - 1) * self.every

    def stacked(self, chosen: np.ndarray | slice = slice(None)) -> np.ndarray:
        """(N, H, W, 3 * STACK) uint8 of the chosen moments, the oldest picture first."""
        last = self.last[chosen]
        parts = [self.pictures[last - back * self.every] for back in range(STACK - 1, -1, -1)]
        return np.concatenate(parts, axis=-1)


def load_stacks(drive: Drive, image: ImageSpec, every: int = 1, see: See | None = None) -> Stacks:
    """All moments of a drive that have the pictures of a stack before them.

    Args:
        drive: pictures of any size and kind; of others than 4:3 the middle is taken.
        image: a policy's picture.
        every: of how many pictures one is taken into a stack.
        see: makes pictures of frames in another way than a policy does.

    Raises:
        ConfigError: the drive is too short, or a file is no picture.
    """
    if len(drive) <= (STACK - 1) * every:
        raise ConfigError(
            f"drive: expected more than {(STACK - 1) * every} pictures, got {len(drive)}"
        )
    frames = np.stack([fit_to_frame(read_picture(file)) for file in drive.files])
    pictures = preprocess_batch(frames, image) if see is None else see(frames)
    last = np.arange((STACK - 1) * every, len(drive))
    return Stacks(pictures, last, turns(drive.steering_deg)[last], every)


def split_by_time(stacks: Stacks) -> tuple[Stacks, Stacks]:
    """(training, test): the first 60 % of the drive, and what comes a gap of 20 frames later.

    No picture is in both. A random split would test on the neighbours of what was trained on.

    Raises:
        ConfigError: nothing would be left to test on.
    """
    end = round(TRAINING_SHARE * len(stacks.pictures))
    training = stacks.last < end
    test = stacks.last - stacks.reach >= end + GAP_FRAMES
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
    px_per_deg: float  # shift between two pictures of a 160 px wide frame for a degree of steering


def shifts_px(drive: Drive) -> np.ndarray:
    """(N - 1,) by how much the far world moves to the left between pictures: to the right we turn.

    Raises:
        ConfigError: a file is no picture.
    """
    rows, columns = _FAR
    shape = columns.stop - columns.start, rows.stop - rows.start
    window = cv2.createHanningWindow(shape, cv2.CV_32F)
    before, found = None, []
    for file in drive.files:
        grey = cv2.cvtColor(fit_to_frame(read_picture(file)), cv2.COLOR_RGB2GRAY)[_FAR]
        now = np.asarray(grey, np.float32)
        if before is not None:
            found.append(-cv2.phaseCorrelate(before, now, window)[0][0])
        before = now
    return np.array(found)


def turning(steering_deg: np.ndarray, moved_px: np.ndarray) -> Turning:
    """How the angles (N,) of a drive go with what its pictures (N - 1,) show.

    Raises:
        ConfigError: they go against each other.
    """
    smooth = np.convolve(moved_px, np.full(_SMOOTHED, 1.0 / _SMOOTHED), mode="same")
    best = Turning(0.0, 0, 0.0)
    for late in range(min(_LATEST, len(smooth) // 2)):
        angle, seen = steering_deg[: len(smooth) - late], smooth[late:]
        if angle.std() == 0.0 or seen.std() == 0.0:
            continue
        correlation = float(np.corrcoef(angle, seen)[0, 1])
        if abs(correlation) > abs(best.correlation):
            slope = correlation * float(seen.std() / angle.std())
            best = Turning(correlation, late, slope)
    if best.correlation < _AGAINST:
        raise ConfigError(
            "angles: expected positive ones where the pictures turn right, got a correlation of "
            f"{best.correlation:.2f}; change the sign of the angles"
        )
    return best


def goes_on_turning(moved_px: np.ndarray, px_per_deg: float, reach: int) -> np.ndarray:
    """(N,) values of `Turn` of who steers as the last pictures turned, and looks at nothing else.

    Args:
        moved_px: (N - 1,), see `shifts_px`.
        px_per_deg: of a `Turning`, above 0.
        reach: how many shifts are seen.
    """
    sums = np.concatenate(([0.0], np.cumsum(moved_px)))
    count = np.arange(len(sums))
    first = np.maximum(0, count - reach)
    mean = (sums - sums[first]) / np.maximum(1, count - first)
    return turns(mean / px_per_deg)
