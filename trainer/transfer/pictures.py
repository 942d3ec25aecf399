"""Folders of pictures, and sheets of them.

Pictures lie in ``image/``, in ``images/image/`` (CamVid), or anywhere in the folder itself; labels,
where there are any, in ``label/`` beside ``image/``.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np

from robot.camera.files import picture_files, play, read_picture
from robot.camera.source import fit_to_frame
from robot.contract import ImageSpec
from robot.errors import ConfigError
from robot.inference.preprocess import preprocess
from robot.output import write_png
from robot.recording.reader import read_frames
from sim_pybullet.scene import SemanticClass

_C = SemanticClass
PAINTS = (_C.WHITE_LINE, _C.YELLOW_LINE, _C.RED_LINE, _C.ROAD)
SHEET_ROWS = 6
_ENLARGED, _GAP = 2, 4  # of pictures on a sheet


class Pictures(NamedTuple):
    """Pictures of several folders."""

    images: np.ndarray  # (N, H, W, 3) uint8 RGB
    folder: np.ndarray  # (N,) which folder each comes from
    files: tuple[Path, ...]  # (N,) where all are folders

    def draw(self, count: int, rng: np.random.Generator) -> np.ndarray:
        """(count,) indices: every folder as often as every other, however many pictures it has."""
        chosen = rng.integers(self.folder.max() + 1, size=count)
        members = [np.flatnonzero(self.folder == k) for k in range(self.folder.max() + 1)]
        return np.array([rng.choice(members[k]) for k in chosen])

    def part(self, chosen: slice) -> Pictures:
        """Some of them."""
        return Pictures(self.images[chosen], self.folder[chosen], self.files[chosen])


def pictures_in(folder: Path) -> list[Path]:
    """The pictures of a folder by name; ConfigError if there are none."""
    inner = (folder / "image", folder / "images" / "image")
    return picture_files(next((each for each in inner if each.is_dir()), folder))


def pictures_of(path: Path) -> Iterator[np.ndarray]:
    """Those (H, W, 3) uint8 RGB of a folder, a video or a robot's recording (.mcap).

    DuckpilotError if there is none.
    """
    if path.suffix == ".mcap":
        return (frame for _, frame in read_frames(path))
    return map(read_picture, pictures_in(path)) if path.is_dir() else play(path)


def label_of(picture: Path) -> np.ndarray:
    """The grey values (H, W) uint8 of a picture's label; ConfigError if there is none."""
    path = picture.parent.parent / "label" / f"{picture.stem}.png"
    label = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE) if path.exists() else None
    if label is None:
        raise ConfigError(
            f"{path}: expected the labels of {picture.name}, got none; "
            "gather frames with python -m trainer collect"
        )
    return np.asarray(label)


def load_pictures(folders: Sequence[Path], image: ImageSpec) -> Pictures:
    """All of `pictures_of` some paths, as a policy's; ConfigError where there are none."""
    if not folders:
        raise ConfigError("pictures: expected at least one folder, got none")
    found = [[preprocess(fit_to_frame(p), image) for p in pictures_of(path)] for path in folders]
    files = tuple(f for path in folders if path.is_dir() for f in pictures_in(path))
    numbers = np.repeat(range(len(found)), [len(some) for some in found])
    return Pictures(np.stack([each for some in found for each in some]), numbers, files)


def load_paint(pictures: Pictures, image: ImageSpec) -> np.ndarray:
    """How much of each pixel is paint or bare road, for pictures of simulated collections.

    (N, 4, H, W) uint8, 255 is all of it: white, yellow and red lines, road; resized by area.
    """
    size, shares = (image.width_px, image.height_px), []
    for label in map(label_of, pictures.files):
        masks = [np.uint8(255) * (label == kind) for kind in PAINTS]
        shares.append([cv2.resize(mask, size, interpolation=cv2.INTER_AREA) for mask in masks])
    return np.array(shares)[:, :, image.crop_top_px :]


def spread(many: int, count: int) -> np.ndarray:
    """(count,) indices, evenly over so many."""
    return np.linspace(0, many - 1, count).astype(int)


def draw_sheet(path: Path, columns: Mapping[str, np.ndarray]) -> None:
    """Write a PNG file of titled columns, each pictures (N, H, W, 3) uint8 RGB of one size."""
    write_png(path, np.hstack([_column(name, shown) for name, shown in columns.items()]))


def _column(name: str, pictures: np.ndarray) -> np.ndarray:
    title = np.full((16, pictures.shape[2] * _ENLARGED + _GAP, 3), 255, np.uint8)
    cv2.putText(title, name, (2, 12), cv2.FONT_HERSHEY_SIMPLEX, 0.4, (0, 0, 0), 1, cv2.LINE_AA)
    large = pictures.repeat(_ENLARGED, 1).repeat(_ENLARGED, 2)
    around = ((0, 0), (0, _GAP), (0, _GAP), (0, 0))
    return np.vstack([title, *np.pad(large, around, constant_values=255)])
