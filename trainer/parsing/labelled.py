"""Frames with labels: pairs on disk, and which of them are held out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from robot.errors import ConfigError
from sim_pybullet.classes import SemanticClass
from trainer.parsing.classes import CAMVID, VOID, LabelSet
from trainer.sequences import ends

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
    """The pairs ``image/<name>`` and ``label/<name>.png`` of a folder, resized.

    The grey values of a label are the simulator's classes where the folder is a collection
    (``python -m trainer collect`` leaves a ``collection.yaml``), else CamVid's.

    Args:
        folder: the pairs' folder, or one whose ``images`` they are.
        labels: what to call what is seen.
        size: (height, width) in pixels.

    Raises:
        ConfigError: no pairs there, a picture without its label, or CamVid's with other labels.
    """
    simulated = is_collection(folder)
    pairs = _pairs(folder)
    if not simulated and labels is not CAMVID:
        raise ConfigError(
            f"{folder}: expected a collection from the simulator for labels {labels.name!r}, got "
            "CamVid's classes; try --labels camvid"
        )
    classes = len(SemanticClass) if simulated else len(CAMVID.classes)
    frames, truth = [], []
    for image, label in pairs:
        frames.append(read_rgb(image, size))
        values = cv2.imread(str(label), cv2.IMREAD_GRAYSCALE)
        values = cv2.resize(np.asarray(values), size[::-1], interpolation=cv2.INTER_NEAREST)
        values = np.where(values < classes, values, VOID).astype(np.uint8)
        truth.append(labels.from_simulator(values) if simulated else values)
    return Labelled(labels, tuple(i.stem for i, _ in pairs), np.stack(frames), np.stack(truth))


def is_collection(folder: Path) -> bool:
    """Whether the simulator's frames and labels lie there (``python -m trainer collect``)."""
    return (folder / "collection.yaml").exists() and (folder / "label").is_dir()


def _pairs(folder: Path) -> list[tuple[Path, Path]]:
    for base in (folder, folder / "images"):
        inside = base / "image"
        images = sorted(p for p in inside.glob("*") if p.suffix.lower() in (".jpg", ".png"))
        if images:
            break
    else:
        raise ConfigError(f"{folder}: expected image/*.jpg with label/*.png beside, found none")
    pairs = [(image, base / "label" / f"{image.stem}.png") for image in images]
    for image, label in pairs:
        if not label.exists():
            raise ConfigError(f"{image}: expected its classes in {label}, found no such file")
    return pairs


def read_rgb(path: Path, size: tuple[int, int] | None = None) -> np.ndarray:
    """A picture (H, W, 3) uint8 RGB, resized by area to (height, width) where given.

    Raises:
        ConfigError: not a picture.
    """
    bgr = cv2.imread(str(path), cv2.IMREAD_COLOR)
    if bgr is None:
        raise ConfigError(f"{path}: expected a picture, got something else")
    if size is not None and bgr.shape[:2] != size:
        bgr = cv2.resize(bgr, size[::-1], interpolation=cv2.INTER_AREA)
    return np.ascontiguousarray(np.asarray(bgr)[..., ::-1])


def split_by_sequence(data: Labelled) -> tuple[Labelled, Labelled]:
    """Training and held-out frames: the last quarter of every sequence is held out.

    See `trainer.sequences`: neighbours look alike, so a random split would test on what was trained
    on.
    """
    held = ends(data.names, HELD_OUT_SHARE)
    return data.pick(np.flatnonzero(~held)), data.pick(np.flatnonzero(held))
