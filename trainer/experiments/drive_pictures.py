"""A recorded drive in pictures: as stacks for a policy, split by time."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from robot.camera.files import read_picture
from robot.camera.source import fit_to_frame
from robot.errors import ConfigError
from trainer.experiments.records import Drive, turns

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

    def stacked(self, chosen: np.ndarray | slice = slice(None)) -> np.ndarray:
        """(N, H, W, 3 * STACK) uint8 of the chosen moments, the oldest picture first."""
        last = self.last[chosen]
        parts = [self.pictures[last - back * self.every] for back in reversed(range(STACK))]
        return np.concatenate(parts, axis=-1)


def frames_of(drive: Drive) -> np.ndarray:
    """(N, 120, 160, 3) uint8 RGB; of pictures that are not 4:3 the middle is taken."""
    return np.stack([fit_to_frame(read_picture(file)) for file in drive.files])


def make_stacks(drive: Drive, frames: np.ndarray, see: See, every: int = 1) -> Stacks:
    """All moments of a drive with a stack's pictures before them; ConfigError if there are none."""
    first = (STACK - 1) * every
    if len(drive.files) <= first:
        raise ConfigError(f"drive: expected more than {first} pictures, got {len(drive.files)}")
    last = np.arange(first, len(drive.files))
    return Stacks(see(frames), last, turns(drive.steering_deg)[last], every)


def split_by_time(stacks: Stacks) -> tuple[Stacks, Stacks]:
    """(training, test): the first 60 % of the drive, and what comes a gap of 20 frames later.

    No picture is in both: a random split would test on the neighbours of what was trained on.
    ConfigError if nothing would be left to test on.
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
