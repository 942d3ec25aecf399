"""Frames with labels: where they come from, and which of them are held out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from robot.errors import ConfigError
from sim_pybullet.classes import SemanticClass
from trainer.sequences import ends
from trainer.transfer.classes import CAMVID, VOID, LabelSet
from trainer.transfer.options import is_collection
from trainer.transfer.pictures import PictureFolder, read_rgb

HELD_OUT_SHARE = 0.25  # of each sequence: its end


@dataclass(frozen=True)
class Labelled:
    """Frames and what is to be seen in them."""

    labels: LabelSet
    names: tuple[str, ...]
    frames: np.ndarray  # (N, H, W, 3) uint8 RGB
    truth: np.ndarray  # (N, H, W) uint8, values of the label set or VOID

    def __len__(self) -> int:
        return len(self.names)

    def pick(self, indices: np.ndarray | Sequence[int]) -> Labelled:
        """Some of them."""
        chosen = np.asarray(indices, dtype=int)
        names = tuple(self.names[i] for i in chosen)
        return Labelled(self.labels, names, self.frames[chosen], self.truth[chosen])


def load_pairs(folder: Path, labels: LabelSet, size: tuple[int, int]) -> Labelled:
    """The pictures of a folder and their labels, resized.

    The grey values of a label are the simulator's classes where the folder is a collection, else
    CamVid's.

    Args:
        folder: see `PictureFolder`.
        labels: what to call what is seen.
        size: (height, width) in pixels.

    Raises:
        ConfigError: no pairs there, a picture without its label, or CamVid's with other labels.
    """
    source, simulated = PictureFolder(folder), is_collection(folder)
    files = source.pictures()
    if not simulated and labels is not CAMVID:
        raise ConfigError(
            f"{folder}: expected a collection from the simulator for labels {labels.name!r}, got "
            "CamVid's classes; try --labels camvid"
        )
    classes = len(SemanticClass) if simulated else len(CAMVID.classes)
    frames, truth = np.stack([read_rgb(file, size) for file in files]), []
    for file in files:
        values = source.label(file)
        values = cv2.resize(values, size[::-1], interpolation=cv2.INTER_NEAREST)
        values = np.where(values < classes, values, VOID).astype(np.uint8)
        truth.append(labels.from_simulator(values) if simulated else values)
    return Labelled(labels, tuple(file.stem for file in files), frames, np.stack(truth))


def split_by_sequence(data: Labelled) -> tuple[Labelled, Labelled]:
    """Training and held-out frames: the last quarter of every sequence is held out.

    See `trainer.sequences`: neighbours look alike, so a random split would test on what was trained
    on.
    """
    held = ends(data.names, HELD_OUT_SHARE)
    return data.pick(np.flatnonzero(~held)), data.pick(np.flatnonzero(held))
