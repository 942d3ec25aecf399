"""Frames and what is to be seen in them: folders of pairs, and annotated photographs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from robot.camera.files import read_picture
from robot.errors import ConfigError
from sim_pybullet.classes import SemanticClass
from trainer.transfer.classes import CAMVID, VOID, LabelSet
from trainer.transfer.options import is_collection
from trainer.transfer.pictures import label_of, pictures_in


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
    """The pictures of a folder and their labels, resized to (height, width).

    The grey values of a label are the simulator's classes where the folder is a collection, else
    CamVid's. ConfigError for a picture without its label, or CamVid's with other labels.
    """
    simulated, files = is_collection(folder), pictures_in(folder)
    if not simulated and labels is not CAMVID:
        raise ConfigError(
            f"{folder}: expected a collection from the simulator for labels {labels.name!r}, got "
            "CamVid's classes; try --labels camvid"
        )
    classes = len(SemanticClass) if simulated else len(CAMVID.classes)
    frames, truth = np.stack([read_rgb(file, size) for file in files]), []
    for file in files:
        values = cv2.resize(label_of(file), size[::-1], interpolation=cv2.INTER_NEAREST)
        values = np.where(values < classes, values, VOID).astype(np.uint8)
        truth.append(labels.from_simulator(values) if simulated else values)
    return Labelled(labels, tuple(file.stem for file in files), frames, np.stack(truth))


def read_rgb(path: Path, size: tuple[int, int]) -> np.ndarray:
    """A picture (H, W, 3) uint8 RGB, resized by area to (height, width)."""
    picture = read_picture(path)
    if picture.shape[:2] == size:
        return picture
    return np.asarray(cv2.resize(picture, size[::-1], interpolation=cv2.INTER_AREA))
