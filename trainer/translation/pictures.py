"""Folders of pictures as arrays of a policy's pictures."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np

from robot.camera.replay import picture_files, read_picture
from robot.camera.source import fit_to_frame
from robot.contract import ImageSpec
from robot.errors import ConfigError
from robot.inference.preprocess import preprocess
from sim_pybullet.classes import SemanticClass

PAINTS = (SemanticClass.WHITE_LINE, SemanticClass.YELLOW_LINE, SemanticClass.RED_LINE)
_KINDS = (*PAINTS, SemanticClass.ROAD)


class Pictures(NamedTuple):
    """Pictures of several folders."""

    images: np.ndarray  # (N, H, W, 3) uint8 RGB
    folder: np.ndarray  # (N,) which folder each comes from
    files: tuple[Path, ...]

    def draw(self, count: int, rng: np.random.Generator) -> np.ndarray:
        """(count,) indices: every folder as often as every other, however many pictures it has."""
        chosen = rng.integers(self.folder.max() + 1, size=count)
        members = [np.flatnonzero(self.folder == k) for k in range(self.folder.max() + 1)]
        return np.array([rng.choice(members[k]) for k in chosen])

    def part(self, chosen: np.ndarray) -> Pictures:
        """Those where ``chosen`` (N,) bool is set."""
        files = tuple(np.array(self.files, object)[chosen])
        return Pictures(self.images[chosen], self.folder[chosen], files)


def load_pictures(folders: Sequence[Path], image: ImageSpec) -> Pictures:
    """All pictures of some folders; of a collection (`trainer.translation.collect`) its ``image/``.

    Raises:
        ConfigError: a folder is absent or holds no pictures, or none was named.
    """
    if not folders:
        raise ConfigError("pictures: expected at least one folder, got none")
    files, numbers = [], []
    for number, folder in enumerate(folders):
        inner = folder / "image"
        found = picture_files(inner if inner.is_dir() else folder)
        files += found
        numbers += [number] * len(found)
    images = np.stack([preprocess(fit_to_frame(read_picture(file)), image) for file in files])
    return Pictures(images, np.array(numbers), tuple(files))


def load_paint(pictures: Pictures, image: ImageSpec) -> np.ndarray:
    """How much of each pixel is paint or bare road, for pictures of simulated collections.

    Returns:
        (N, 4, H, W) uint8, 255 is all of it: white, yellow and red lines, road.

    Raises:
        ConfigError: a picture has no label beside it.
    """
    shares = []
    for file in pictures.files:
        path = file.parent.parent / "label" / file.name
        label = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE) if path.exists() else None
        if label is None:
            raise ConfigError(
                f"{path}: expected the labels of a simulated picture, got none; "
                "gather frames with python -m trainer collect"
            )
        whole = np.stack([np.where(label == kind, 255, 0) for kind in _KINDS])
        shares.append(paint_shares(whole.astype(np.uint8), image))
    return np.stack(shares)


def paint_shares(whole: np.ndarray, image: ImageSpec) -> np.ndarray:
    """Masks (4, 120, 160) of a frame as (4, H, W) of the policy's picture, resized by area."""
    size = (image.width_px, image.height_px)
    resized = [cv2.resize(mask, size, interpolation=cv2.INTER_AREA) for mask in whole]
    return np.stack(resized)[:, image.crop_top_px :]
