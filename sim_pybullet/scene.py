"""``Scene``: what there is to see, independent of who looks; both cameras draw the same Scene."""

from dataclasses import dataclass
from enum import IntEnum
from typing import Literal

import numpy as np

from sim_pybullet.look import LightLook, SkyLook


class SemanticClass(IntEnum):
    """Values of a segmentation picture, uint8."""

    SKY = 0
    OUTSIDE = 1  # floor, grass and what lies beyond the map
    ROAD = 2
    WHITE_LINE = 3
    YELLOW_LINE = 4
    RED_LINE = 5
    OBJECT = 6  # anything solid that is not one of the following
    SIGN = 7
    PERSON = 8  # duckies
    VEHICLE = 9
    KERB = 10
    WALL = 11


@dataclass(frozen=True, eq=False)
class Ground:
    """The floor as one picture, seen from above; row 0 is the north edge, column 0 the west edge.

    Texel (row, column) covers the square whose south-west corner is at
    x = west_m + column * texel_m, y = north_m - (row + 1) * texel_m. Beyond the picture the floor
    goes on without end in ``outside_rgb``, class OUTSIDE.
    """

    rgb: np.ndarray  # (H, W, 3) uint8
    classes: np.ndarray  # (H, W) uint8, SemanticClass
    texel_m: float
    west_m: float
    north_m: float
    outside_rgb: tuple[float, float, float]


@dataclass(frozen=True)
class Solid:
    """A box or an upright cylinder."""

    shape: Literal["box", "cylinder"]
    x_m: float
    y_m: float
    heading_rad: float
    size_m: tuple[float, float, float]  # along the heading (a cylinder's diameter), across, up
    rgb: tuple[float, float, float]
    kind: SemanticClass = SemanticClass.OBJECT
    base_m: float = 0.0  # height of its underside above the floor
    collides: bool = True


Mover = tuple[Solid, ...]  # what moves as a whole: solids about its own origin


@dataclass(frozen=True, eq=False)
class Scene:
    """Floor, solids, sky and light."""

    ground: Ground
    solids: tuple[Solid, ...]
    sky: SkyLook
    light: LightLook
