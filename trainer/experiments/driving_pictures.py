"""A recorded drive as stacks of a policy's pictures, and its split by time."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from robot.camera.source import fit_to_frame
from robot.contract import ImageSpec
from robot.errors import ConfigError
from robot.inference.preprocess import preprocess_batch
from trainer.experiments.records import Drive, turns
from trainer.parsing.labelled import read_rgb

See = Callable[[np.ndarray], np.ndarray]  # frames (N, 120, 160, 3) -> pictures (N, H, W, 3), uint8
STACK = 4  # paper B: four consecutive frames
TRAINING_SHARE = 0.6
GAP_FRAMES = 20  # between training and test: neighbours look alike


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
    frames = np.stack([fit_to_frame(read_rgb(file)) for file in drive.files])
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
