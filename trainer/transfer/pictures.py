"""Folders of pictures: photographs, CamVid's pairs, collections from the simulator."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
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


@dataclass(frozen=True)
class PictureFolder:
    """Pictures in ``image/``, in ``images/image/`` (CamVid), or anywhere in the folder itself.

    Labels, where there are any, lie in ``label/`` beside ``image/``.
    """

    path: Path

    def pictures(self) -> list[Path]:
        """The pictures by name; ConfigError if there are none."""
        inner = (self.path / "image", self.path / "images" / "image")
        return picture_files(next((each for each in inner if each.is_dir()), self.path))

    @staticmethod
    def label(picture: Path) -> np.ndarray:
        """The grey values (H, W) uint8 of a picture's label.

        Raises:
            ConfigError: there is none.
        """
        path = picture.parent.parent / "label" / f"{picture.stem}.png"
        label = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE) if path.exists() else None
        if label is None:
            raise ConfigError(
                f"{path}: expected the labels of {picture.name}, got none; "
                "gather frames with python -m trainer collect"
            )
        return np.asarray(label)


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


def spread(many: int, count: int) -> np.ndarray:
    """(count,) indices, evenly over so many."""
    return np.linspace(0, many - 1, count).astype(int)


def load_pictures(folders: Sequence[Path], image: ImageSpec) -> Pictures:
    """All pictures of some folders, as a policy's pictures.

    Raises:
        ConfigError: a folder is absent or holds no pictures, or none was named.
    """
    if not folders:
        raise ConfigError("pictures: expected at least one folder, got none")
    found = [PictureFolder(folder).pictures() for folder in folders]
    files = tuple(file for some in found for file in some)
    images = np.stack([preprocess(fit_to_frame(read_picture(file)), image) for file in files])
    return Pictures(images, np.repeat(range(len(found)), [len(some) for some in found]), files)


def load_paint(pictures: Pictures, image: ImageSpec) -> np.ndarray:
    """How much of each pixel is paint or bare road, for pictures of simulated collections.

    Returns:
        (N, 4, H, W) uint8, 255 is all of it: white, yellow and red lines, road; resized by area.

    Raises:
        ConfigError: a picture has no label beside it.
    """
    size, shares = (image.width_px, image.height_px), []
    for file in pictures.files:
        label = PictureFolder.label(file)
        masks = [np.where(label == kind, 255, 0).astype(np.uint8) for kind in _KINDS]
        shares.append([cv2.resize(mask, size, interpolation=cv2.INTER_AREA) for mask in masks])
    return np.array(shares)[:, :, image.crop_top_px :]


def read_rgb(path: Path, size: tuple[int, int] | None = None) -> np.ndarray:
    """A picture (H, W, 3) uint8 RGB, resized by area to (height, width) where given.

    Raises:
        ConfigError: not a picture.
    """
    picture = read_picture(path)
    if size is None or picture.shape[:2] == size:
        return picture
    return np.asarray(cv2.resize(picture, size[::-1], interpolation=cv2.INTER_AREA))
