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
from trainer.transfer.classes import ROAD, VOID, LabelSet, RoadClass
from trainer.transfer.labelled import Labelled, load_pairs, split_by_sequence
from trainer.transfer.options import Sources
from trainer.transfer.pictures import read_rgb

ANNOTATIONS_DIR = Path(__file__).parent / "annotations"
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


@dataclass(frozen=True)
class Split:
    """One source of labelled frames."""

    name: str
    training: Labelled
    held_out: Labelled


def load_sources(sources: Sources, labels: LabelSet, size: tuple[int, int]) -> list[Split]:
    """The training and held-out frames of each source, annotated photographs last.

    Args:
        sources: where they come from.
        labels: what to call what is seen.
        size: (height, width) of the frames [px].

    Raises:
        ConfigError: no source, or one that does not hold what it should.
    """
    splits = []
    for folder in sources.pairs:
        pairs = load_pairs(Path(folder), labels, size)
        splits.append(Split(folder, *split_by_sequence(pairs)))
    if sources.annotations:
        if not sources.photos or labels is not ROAD:
            raise ConfigError("annotations: expected --photos, and --labels road")
        annotated = load_annotations(sources.annotations)
        halves = load_annotated(annotated, Path(sources.photos), size)
        splits.append(Split(sources.annotations, *halves))
    if not splits:
        raise ConfigError("parse: expected --pairs or --annotations with --photos, got none")
    return splits


def shipped_annotations() -> dict[str, Path]:
    """The annotations that come with the project, by name."""
    return {path.stem: path for path in sorted(ANNOTATIONS_DIR.glob("*.yaml"))}


def load_annotations(source: str | Path) -> Annotations:
    """Annotations from a file, or the name of shipped ones.

    Raises:
        ConfigError: no such file or name, or it does not fit.
    """
    shipped = shipped_annotations()
    path = source if Path(source).exists() else shipped.get(str(source))
    if path is None:
        said = nearest(str(source), shipped)
        raise ConfigError(f"annotations {str(source)!r}: no such file; {said}")
    return load_yaml(Annotations, Path(path))


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
    for photograph in annotations.photographs:
        if photograph.file not in paths:
            raise ConfigError(
                f"{photographs}: expected the annotated photograph {photograph.file}, found none "
                "of that name; point --photos at the set that was annotated"
            )

    def half(held_out: bool) -> Labelled:
        some = [each for each in annotations.photographs if each.held_out == held_out]
        frames = [read_rgb(paths[each.file], size) for each in some]
        truth = [draw(each, annotations.size, size) for each in some]
        names = tuple(each.file for each in some)
        return Labelled(
            ROAD,
            names,
            np.array(frames, np.uint8).reshape(-1, *size, 3),
            np.array(truth, np.uint8).reshape(-1, *size),
        )

    return half(False), half(True)


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
        if shape.kind not in _VALUES:
            said = nearest(shape.kind, _VALUES)
            raise ConfigError(f"{photograph.file}: unknown class {shape.kind!r}; {said}")
        # OpenCV's whole numbers are the middles of pixels
        points = np.round((np.array(shape.points) * scale - 0.5) * one).astype(np.int32)
        value, drawn = _VALUES[shape.kind], (cv2.LINE_8, _FRACTION_BITS)
        if shape.width > 0.0:
            width = max(1, round(shape.width * float(scale.mean())))
            cv2.polylines(picture, [points], False, value, width, *drawn)
        else:
            cv2.fillPoly(picture, [points], value, *drawn)
    return picture
