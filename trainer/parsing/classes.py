"""Three label sets, and where each of the simulator's classes goes in them.

`CamVidClass` are the eleven classes of labelled full-size roads; `RoadClass` are the six that a
small robot's road needs and that a person can draw on a photograph in a minute; `TrackClass` are
the seven that a race track is made of.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum

import numpy as np

from robot.errors import ConfigError, nearest
from sim_pybullet.classes import SemanticClass

VOID = 255  # a pixel that nobody labelled: neither trained on nor counted

Rgb = tuple[int, int, int]


class CamVidClass(IntEnum):
    """The eleven classes of SegNet's CamVid label files (Badrinarayanan et al. 2017)."""

    SKY = 0
    BUILDING = 1
    POLE = 2
    ROAD = 3
    PAVEMENT = 4
    TREE = 5
    SIGN_SYMBOL = 6
    FENCE = 7
    CAR = 8
    PEDESTRIAN = 9
    BICYCLIST = 10


class RoadClass(IntEnum):
    """What matters on a robot's road."""

    BACKGROUND = 0  # whatever is not the road and does not stand on or beside it
    ROAD = 1
    WHITE_LINE = 2
    YELLOW_LINE = 3
    RED_LINE = 4
    OBJECT = 5  # duckies, signs, houses, cones, vehicles


class TrackClass(IntEnum):
    """What a race track is made of; its dashes tell how fast a car is."""

    SKY = 0
    GRASS = 1
    ROAD = 2
    WHITE_LINE = 3
    YELLOW_LINE = 4
    KERB = 5
    WALL = 6


@dataclass(frozen=True)
class LabelSet:
    """Names, colours [0..255] and the simulator's classes of one set of labels."""

    name: str
    classes: tuple[str, ...]
    colours: tuple[Rgb, ...]
    of_simulator: tuple[int, ...]  # indexed by SemanticClass

    def from_simulator(self, labels: np.ndarray) -> np.ndarray:
        """Values of `SemanticClass`, any shape -> values of this set, uint8."""
        return np.array(self.of_simulator, np.uint8)[labels]

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
        scores = (colours**2).sum(1) - 2 * (pixels @ colours.T)
        return scores.argmin(-1).astype(np.uint8)


_S, _C, _R, _T = SemanticClass, CamVidClass, RoadClass, TrackClass

_CAMVID_OF: dict[SemanticClass, CamVidClass] = {
    _S.SKY: _C.SKY,
    _S.OUTSIDE: _C.TREE,  # grass: CamVid puts what grows under "tree"
    _S.ROAD: _C.ROAD,
    _S.WHITE_LINE: _C.ROAD,  # CamVid's eleven classes hold no lane markings
    _S.YELLOW_LINE: _C.ROAD,
    _S.RED_LINE: _C.ROAD,
    _S.OBJECT: _C.BUILDING,
    _S.SIGN: _C.SIGN_SYMBOL,
    _S.PERSON: _C.PEDESTRIAN,
    _S.VEHICLE: _C.CAR,
    _S.KERB: _C.PAVEMENT,
    _S.WALL: _C.FENCE,
}
_ROAD_OF: dict[SemanticClass, RoadClass] = {
    _S.SKY: _R.BACKGROUND,
    _S.OUTSIDE: _R.BACKGROUND,
    _S.ROAD: _R.ROAD,
    _S.WHITE_LINE: _R.WHITE_LINE,
    _S.YELLOW_LINE: _R.YELLOW_LINE,
    _S.RED_LINE: _R.RED_LINE,
    _S.OBJECT: _R.OBJECT,
    _S.SIGN: _R.OBJECT,
    _S.PERSON: _R.OBJECT,
    _S.VEHICLE: _R.OBJECT,
    _S.KERB: _R.BACKGROUND,
    _S.WALL: _R.BACKGROUND,
}
_TRACK_OF: dict[SemanticClass, TrackClass] = {
    **dict.fromkeys(_S, _T.WALL),  # whatever stands there
    _S.SKY: _T.SKY,
    _S.OUTSIDE: _T.GRASS,
    _S.ROAD: _T.ROAD,
    _S.WHITE_LINE: _T.WHITE_LINE,
    _S.YELLOW_LINE: _T.YELLOW_LINE,
    _S.RED_LINE: _T.WHITE_LINE,
    _S.KERB: _T.KERB,
}

# CamVid's own colours; the road's six lie far apart, so that a generated picture can be read.
CAMVID = LabelSet(
    "camvid",
    tuple(c.name.lower() for c in CamVidClass),
    (
        (128, 128, 128),
        (128, 0, 0),
        (192, 192, 128),
        (128, 64, 128),
        (60, 40, 222),
        (128, 128, 0),
        (192, 128, 128),
        (64, 64, 128),
        (64, 0, 128),
        (64, 64, 0),
        (0, 128, 192),
    ),
    tuple(int(_CAMVID_OF[c]) for c in SemanticClass),
)
ROAD = LabelSet(
    "road",
    tuple(c.name.lower() for c in RoadClass),
    ((0, 0, 255), (70, 70, 70), (255, 255, 255), (255, 255, 0), (255, 0, 0), (0, 255, 0)),
    tuple(int(_ROAD_OF[c]) for c in SemanticClass),
)
TRACK = LabelSet(
    "track",
    tuple(c.name.lower() for c in TrackClass),
    (
        (0, 128, 255),
        (0, 160, 0),
        (70, 70, 70),
        (255, 255, 255),
        (255, 255, 0),
        (255, 0, 0),
        (90, 0, 110),
    ),
    tuple(int(_TRACK_OF[c]) for c in SemanticClass),
)
LABEL_SETS = {labels.name: labels for labels in (CAMVID, ROAD, TRACK)}


def label_set(name: str) -> LabelSet:
    """The label set of that name.

    Raises:
        ConfigError: there is none.
    """
    if name not in LABEL_SETS:
        raise ConfigError(f"label set: unknown {name!r}; {nearest(name, LABEL_SETS)}")
    return LABEL_SETS[name]
