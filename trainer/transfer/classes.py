"""Three label sets, and where each of the simulator's classes goes in them.

``CAMVID`` are the eleven classes of SegNet's CamVid label files (Badrinarayanan et al. 2017), in
CamVid's colours; ``ROAD`` the six that a small robot's road needs and that a person can draw on a
photograph in a minute; ``TRACK`` the seven that a race track is made of (its dashes tell how fast a
car is). The colours of the last two lie far apart, so that a generated picture can be read.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sim_pybullet.classes import SemanticClass

VOID = 255  # a pixel that nobody labelled: neither trained on nor counted

Rgb = tuple[int, int, int]


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
