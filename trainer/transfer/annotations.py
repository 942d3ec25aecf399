"""Labels that a person drew on photographs, which lie elsewhere.

A file has a ``size`` [width, height] that its pixels count in, and for each photograph by name
whether it is held out and its ``shapes``: a class of `RoadClass` and a polygon [[x, y], ...] or,
with a ``width``, a line. Later shapes cover earlier ones; the rest is background.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from robot.errors import ConfigError, nearest
from robot.typed_config import load_yaml
from trainer.transfer.classes import ROAD, VOID, RoadClass
from trainer.transfer.labelled import Labelled, read_rgb

SHIPPED = {path.stem: path for path in (Path(__file__).parent / "annotations").glob("*.yaml")}
_VALUES = {**{name: k for k, name in enumerate(ROAD.classes)}, "void": VOID}
_FRACTION_BITS = 4  # sub-pixels of OpenCV's polygons


@dataclass(frozen=True)
class Shape:
    """One thing on a photograph."""

    kind: str  # a class in lower case, or void
    points: tuple[tuple[float, float], ...]  # x, y [px], continuous: (0, 0) is the top left corner
    width: float = 0.0  # [px]; of a line; 0 is a filled polygon


@dataclass(frozen=True)
class Photograph:
    """What a person saw on one photograph."""

    file: str  # its name, without folders
    held_out: bool
    shapes: tuple[Shape, ...]


@dataclass(frozen=True)
class Annotations:
    """A file of them."""

    size: tuple[int, int]  # width, height that the points count in
    photographs: tuple[Photograph, ...]


def load_annotations(source: str | Path) -> Annotations:
    """Annotations from a file, or the name of shipped ones; ConfigError if there are none."""
    path = source if Path(source).exists() else SHIPPED.get(str(source))
    if path is None:
        said = nearest(str(source), SHIPPED)
        raise ConfigError(f"annotations {str(source)!r}: no such file; {said}")
    return load_yaml(Annotations, Path(path))


def load_annotated(
    annotations: Annotations, photographs: Path, size: tuple[int, int]
) -> tuple[Labelled, Labelled]:
    """(training, held-out) frames (height, width) with the labels drawn on them.

    ConfigError if the folder does not hold one of the photographs, at any depth.
    """
    paths = {path.name: path for path in photographs.rglob("*") if path.is_file()}
    drawn = annotations.photographs
    for photograph in drawn:
        if photograph.file not in paths:
            raise ConfigError(
                f"{photographs}: expected the annotated photograph {photograph.file}, found none "
                "of that name; point --photos at the set that was annotated"
            )
    frames = np.array([read_rgb(paths[each.file], size) for each in drawn]).reshape(-1, *size, 3)
    truth = np.array([draw(each, annotations.size, size) for each in drawn]).reshape(-1, *size)
    everything = Labelled(ROAD, tuple(each.file for each in drawn), frames, truth)
    held = np.array([each.held_out for each in drawn], bool)
    return everything.pick(np.flatnonzero(~held)), everything.pick(np.flatnonzero(held))


def draw(photograph: Photograph, drawn_in: tuple[int, int], size: tuple[int, int]) -> np.ndarray:
    """(H, W) uint8 labels of one photograph, whose shapes count in (width, height) ``drawn_in``.

    ConfigError for a shape of an unknown class.
    """
    picture = np.full(size, RoadClass.BACKGROUND, np.uint8)
    scale = np.array(size[::-1]) / np.array(drawn_in)
    for shape in photograph.shapes:
        if shape.kind not in _VALUES:
            said = nearest(shape.kind, _VALUES)
            raise ConfigError(f"{photograph.file}: unknown class {shape.kind!r}; {said}")
        # OpenCV's whole numbers are the middles of pixels
        points = np.round((np.array(shape.points) * scale - 0.5) * 2**_FRACTION_BITS)
        value, how = _VALUES[shape.kind], (cv2.LINE_8, _FRACTION_BITS)
        if shape.width > 0.0:
            width = max(1, round(shape.width * float(scale.mean())))
            cv2.polylines(picture, [points.astype(np.int32)], False, value, width, *how)
        else:
            cv2.fillPoly(picture, [points.astype(np.int32)], value, *how)
    return picture
