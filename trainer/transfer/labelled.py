"""Frames and what is to be seen in them: folders of pairs, and photographs that a person drew on.

There are three label sets. ``CAMVID`` are the eleven classes of SegNet's CamVid label files
(Badrinarayanan et al. 2017), in CamVid's colours; ``ROAD`` the six that a small robot's road needs
and that a person can draw on a photograph in a minute; ``TRACK`` the seven that a race track is
made of (its dashes tell how fast a car is). The colours of the last two lie far apart, so that a
generated picture can be read.

A file of annotations has a ``size`` [width, height] that its pixels count in, and for each
photograph by name whether it is held out and its ``shapes``: a class of `ROAD` and a polygon
[[x, y], ...] or, with a ``width``, a line. Later shapes cover earlier ones; the rest is background.
The photographs lie elsewhere.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple, Self

import cv2
import numpy as np

from robot.camera.files import read_picture
from robot.errors import ConfigError
from robot.typed_config import load_yaml, named_file
from sim_pybullet.scene import SemanticClass
from trainer.config import expect_one_of
from trainer.transfer.cli import ParseOptions, is_collection
from trainer.transfer.pictures import label_of, pictures_in

VOID = 255  # a pixel that nobody labelled: neither trained on nor counted

Rgb = tuple[int, int, int]


@dataclass(frozen=True)
class LabelSet:
    """Names, colours [0..255] and the simulator's classes of one set of labels."""

    name: str
    classes: tuple[str, ...]
    colours: tuple[Rgb, ...]
    of_simulator: tuple[int, ...]  # values of this set, indexed by those of SemanticClass

    def paint(self, labels: np.ndarray) -> np.ndarray:
        """Labels (..., H, W) -> a picture (..., H, W, 3) uint8; void is black."""
        table = np.zeros((256, 3), np.uint8)
        table[: len(self.colours)] = self.colours
        return table[labels]

    def read(self, picture: np.ndarray) -> np.ndarray:
        """A picture (..., 3) uint8 -> the labels whose colours are nearest, uint8."""
        colours = np.array(self.colours, np.int32)
        pixels = picture.astype(np.int32)
        # |p - c|^2 less |p|^2, which is the same for all colours
        return ((colours**2).sum(1) - 2 * (pixels @ colours.T)).argmin(-1).astype(np.uint8)


_S = SemanticClass
# Of the simulator's classes: their names in CAMVID, ROAD and TRACK.
_PLACES = {
    _S.SKY: ("sky", "background", "sky"),
    _S.OUTSIDE: ("tree", "background", "grass"),  # CamVid puts what grows under "tree"
    _S.ROAD: ("road", "road", "road"),
    _S.WHITE_LINE: ("road", "white_line", "white_line"),  # CamVid has no lane markings
    _S.YELLOW_LINE: ("road", "yellow_line", "yellow_line"),
    _S.RED_LINE: ("road", "red_line", "white_line"),
    _S.OBJECT: ("building", "object", "wall"),  # on a track: whatever stands there
    _S.SIGN: ("sign_symbol", "object", "wall"),
    _S.PERSON: ("pedestrian", "object", "wall"),
    _S.VEHICLE: ("car", "object", "wall"),
    _S.KERB: ("pavement", "background", "kerb"),
    _S.WALL: ("fence", "background", "wall"),
}


def _label_set(name: str, column: int, colours: dict[str, Rgb]) -> LabelSet:
    names = tuple(colours)
    places = tuple(names.index(_PLACES[each][column]) for each in _S)
    return LabelSet(name, names, tuple(colours.values()), places)


CAMVID = _label_set("camvid", 0, {
    "sky": (128, 128, 128), "building": (128, 0, 0), "pole": (192, 192, 128),
    "road": (128, 64, 128), "pavement": (60, 40, 222), "tree": (128, 128, 0),
    "sign_symbol": (192, 128, 128), "fence": (64, 64, 128), "car": (64, 0, 128),
    "pedestrian": (64, 64, 0), "bicyclist": (0, 128, 192),
})  # fmt: skip
ROAD = _label_set("road", 1, {
    "background": (0, 0, 255), "road": (70, 70, 70), "white_line": (255, 255, 255),
    "yellow_line": (255, 255, 0), "red_line": (255, 0, 0), "object": (0, 255, 0),
})  # fmt: skip
TRACK = _label_set("track", 2, {
    "sky": (0, 128, 255), "grass": (0, 160, 0), "road": (70, 70, 70),
    "white_line": (255, 255, 255), "yellow_line": (255, 255, 0), "kerb": (255, 0, 0),
    "wall": (90, 0, 110),
})  # fmt: skip
LABEL_SETS = {labels.name: labels for labels in (CAMVID, ROAD, TRACK)}

SHIPPED = {path.stem: path for path in (Path(__file__).parent / "annotations").glob("*.yaml")}
HELD_OUT_SHARE = 0.25  # of each sequence: its end, see `ends`
_VALUES = {**{name: k for k, name in enumerate(ROAD.classes)}, "void": VOID}
_FRACTION_BITS = 4  # sub-pixels of OpenCV's polygons


@dataclass(frozen=True)
class Shape:
    """One thing on a photograph."""

    kind: str  # a class, or void
    points: tuple[tuple[float, float], ...]  # x, y [px], continuous: (0, 0) is the top left corner
    width: float = 0.0  # [px]; of a line; 0 is a filled polygon

    def __post_init__(self) -> None:
        if not self.points or not 0.0 <= self.width <= 1000.0:
            raise ConfigError(f"shape: expected points, a width of 0 to 1000, got {self}")


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

    def __post_init__(self) -> None:
        if not self.photographs or min(self.size) < 1:
            raise ConfigError(f"annotations: expected photographs of a size, got {self}")


class Labelled(NamedTuple):
    """Frames and what is to be seen in them."""

    names: np.ndarray  # (N,) of the pictures' files
    frames: np.ndarray  # (N, H, W, 3) uint8 RGB
    truth: np.ndarray  # (N, H, W) uint8, values of a label set or VOID

    def pick(self, chosen: np.ndarray) -> Self:
        """Some of them, by (N,) bool or by indices."""
        return type(self)(*(part[chosen] for part in self))


def load_sources(options: ParseOptions) -> list[tuple[str, Labelled, Labelled]]:
    """The name, the training and the held-out frames of each source, annotated ones last.

    The last quarter of every sequence of pairs is held out. ConfigError if there is no source.
    """
    found, sources, labels = [], options.sources, LABEL_SETS[options.labels]
    for folder in sources.pairs:
        pairs = load_pairs(Path(folder), labels, options.size)
        found.append((folder, pairs, ends(pairs.names.tolist(), HELD_OUT_SHARE)))
    if sources.annotations:
        if not sources.photos or labels is not ROAD:
            raise ConfigError("annotations: expected --photos, and --labels road")
        drawn = load_annotations(sources.annotations)
        held = np.array([each.held_out for each in drawn.photographs])
        pictures = load_drawn(drawn, Path(sources.photos), options.size)
        found.append((sources.annotations, pictures, held))
    if not found:
        raise ConfigError("parse: expected --pairs or --annotations with --photos, got none")
    if wrong := [name for name, _, held in found if held.all() or not held.any()]:
        raise ConfigError(f"{wrong[0]}: expected frames to learn from and others held out")
    return [(name, data.pick(~held), data.pick(held)) for name, data, held in found]


def ends(names: Sequence[str], share: float) -> np.ndarray:
    """(N,) bool: what is held out, the last ``share`` of every sequence, for neighbours look alike.

    A sequence is what shares the name before the last underscore; names sort by time.
    """
    chosen = np.zeros(len(names), bool)
    sequences: dict[str, list[int]] = {}
    for i in sorted(range(len(names)), key=names.__getitem__):
        sequences.setdefault(names[i].rpartition("_")[0], []).append(i)
    for members in sequences.values():
        chosen[members[len(members) - round(share * len(members)) :]] = True
    return chosen


def load_pairs(folder: Path, labels: LabelSet, size: tuple[int, int]) -> Labelled:
    """The pictures of a folder and their labels, resized to (height, width).

    The grey values of a label are the simulator's classes where the folder is a collection, else
    CamVid's. ConfigError for a picture without its label, or CamVid's with other labels.
    """
    simulated, files = is_collection(folder), pictures_in(folder)
    if not simulated and labels is not CAMVID:
        told = f"{labels.name!r}, got CamVid's classes; try --labels camvid"
        raise ConfigError(f"{folder}: expected a collection from the simulator for labels {told}")
    classes = len(SemanticClass) if simulated else len(CAMVID.classes)
    frames, truth = np.stack([_read(file, size) for file in files]), []
    for file in files:
        values = cv2.resize(label_of(file), size[::-1], interpolation=cv2.INTER_NEAREST)
        values = np.where(values < classes, values, VOID).astype(np.uint8)
        truth.append(np.array(labels.of_simulator, np.uint8)[values] if simulated else values)
    return Labelled(np.array([file.stem for file in files]), frames, np.stack(truth))


def load_annotations(source: str) -> Annotations:
    """Annotations from a file, or the name of shipped ones; ConfigError if there are none."""
    return load_yaml(Annotations, named_file("annotations", source, SHIPPED))


def load_drawn(annotations: Annotations, photographs: Path, size: tuple[int, int]) -> Labelled:
    """Photographs resized to (height, width), with the labels drawn on them.

    ConfigError if the folder does not hold one of them, at any depth.
    """
    every = [path for path in photographs.rglob("*") if path.is_file()]
    paths, drawn = {path.name: path for path in every}, annotations.photographs
    for photograph in drawn:
        if (count := [path.name for path in every].count(photograph.file)) != 1:
            told = f"{photograph.file}, found {count}; point --photos at the set that was annotated"
            raise ConfigError(f"{photographs}: expected one photograph named {told}")
    frames = np.stack([_read(paths[each.file], size) for each in drawn])
    truth = np.stack([draw(each, annotations.size, size) for each in drawn])
    return Labelled(np.array([each.file for each in drawn]), frames, truth)


def draw(photograph: Photograph, drawn_in: tuple[int, int], size: tuple[int, int]) -> np.ndarray:
    """(H, W) uint8 labels of one photograph, whose shapes count in (width, height) ``drawn_in``.

    ConfigError for a shape of an unknown class.
    """
    picture = np.zeros(size, np.uint8)  # background
    scale = np.array(size[::-1]) / np.array(drawn_in)
    for shape in photograph.shapes:
        expect_one_of(f"{photograph.file}: class", shape.kind, _VALUES)
        # OpenCV's whole numbers are the middles of pixels
        points = np.round((np.array(shape.points) * scale - 0.5) * 2**_FRACTION_BITS)
        value, how = _VALUES[shape.kind], (cv2.LINE_8, _FRACTION_BITS)
        if shape.width > 0.0:
            width = max(1, round(shape.width * float(scale.mean())))
            cv2.polylines(picture, [points.astype(np.int32)], False, value, width, *how)
        else:
            cv2.fillPoly(picture, [points.astype(np.int32)], value, *how)
    return picture


def _read(path: Path, size: tuple[int, int]) -> np.ndarray:
    return np.asarray(cv2.resize(read_picture(path), size[::-1], interpolation=cv2.INTER_AREA))
