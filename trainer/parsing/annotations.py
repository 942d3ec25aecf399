"""Labels that a person drew on photographs: polygons in a YAML file, the photographs elsewhere.

A file has a ``size`` [width, height] that its pixels count in, and for each photograph by name
whether it is held out and its ``shapes``: a class of `RoadClass` and a polygon [[x, y], ...] or,
with a ``width``, a line. Later shapes cover earlier ones. What no shape covers is background.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from robot.errors import ConfigError, nearest
from robot.typed_config import load_yaml
from trainer.parsing.classes import ROAD, VOID, RoadClass
from trainer.parsing.labelled import Labelled, read_rgb

ANNOTATIONS_DIR = Path(__file__).parent / "annotations"
_VOID_NAME = "void"
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


def shipped_annotations() -> dict[str, Path]:
    """The annotations that come with the project, by name."""
    return {path.stem: path for path in sorted(ANNOTATIONS_DIR.glob("*.yaml"))}


def load_annotations(source: str | Path) -> Annotations:
    """Annotations from a file, or the name of shipped ones.

    Raises:
        ConfigError: no such file or name, or it does not fit.
    """
    path = Path(source)
    if not path.exists():
        shipped = shipped_annotations()
        if str(source) not in shipped:
            raise ConfigError(
                f"annotations {str(source)!r}: no such file; {nearest(str(source), shipped)}"
            )
        path = shipped[str(source)]
    return load_yaml(Annotations, path)


def load_annotated(
    annotations: Annotations, photographs: Path, size: tuple[int, int]
) -> tuple[Labelled, Labelled]:
    """(training, held-out) frames with the labels drawn on them.

    Args:
        annotations: what was drawn.
        photographs: a folder that holds the photographs, at any depth.
        size: (height, width) in pixels of what is returned.

    Raises:
        ConfigError: a photograph is missing.
    """
    paths = {path.name: path for path in photographs.rglob("*") if path.is_file()}
    halves: dict[bool, list[Photograph]] = {False: [], True: []}
    for photograph in annotations.photographs:
        if photograph.file not in paths:
            raise ConfigError(
                f"{photographs}: expected the annotated photograph {photograph.file}, found none "
                "of that name; point --photos at the set that was annotated"
            )
        halves[photograph.held_out].append(photograph)
    training, held_out = (_labelled(half, paths, annotations, size) for half in halves.values())
    return training, held_out


def _labelled(
    photographs: list[Photograph],
    paths: dict[str, Path],
    annotations: Annotations,
    size: tuple[int, int],
) -> Labelled:
    frames = np.zeros((len(photographs), *size, 3), np.uint8)
    truth = np.zeros((len(photographs), *size), np.uint8)
    for i, photograph in enumerate(photographs):
        frames[i] = read_rgb(paths[photograph.file], size)
        truth[i] = draw(photograph, annotations.size, size)
    return Labelled(ROAD, tuple(p.file for p in photographs), frames, truth)


def draw(photograph: Photograph, drawn_in: tuple[int, int], size: tuple[int, int]) -> np.ndarray:
    """(H, W) uint8 labels of one photograph.

    Args:
        photograph: its shapes.
        drawn_in: (width, height) in pixels that the shapes count in.
        size: (height, width) in pixels of what is returned.

    Raises:
        ConfigError: a shape of an unknown class.
    """
    picture = np.full(size, RoadClass.BACKGROUND, np.uint8)
    scale = np.array(size[::-1]) / np.array(drawn_in)
    one = 1 << _FRACTION_BITS
    for shape in photograph.shapes:
        # OpenCV's whole numbers are the middles of pixels
        points = np.round((np.array(shape.points) * scale - 0.5) * one).astype(np.int32)
        value = _value(shape.kind, photograph.file)
        if shape.width > 0.0:
            width = max(1, round(shape.width * float(scale.mean())))
            cv2.polylines(picture, [points], False, value, width, cv2.LINE_8, _FRACTION_BITS)
        else:
            cv2.fillPoly(picture, [points], value, cv2.LINE_8, _FRACTION_BITS)
    return picture


def _value(kind: str, file: str) -> int:
    if kind == _VOID_NAME:
        return VOID
    if kind not in ROAD.classes:
        raise ConfigError(f"{file}: unknown class {kind!r}; {nearest(kind, ROAD.classes)}")
    return ROAD.classes.index(kind)
