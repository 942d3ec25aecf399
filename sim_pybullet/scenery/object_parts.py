"""What objects of a map are made of: boxes and cylinders, in units of the object's height.

Forward is where the object's front looks, left is to its left; ``size`` is (length forward, width,
height). Proportions are those of the toys and signs on a Duckietown table.
"""

from __future__ import annotations

from typing import Literal, NamedTuple

from sim_pybullet.classes import SemanticClass
from sim_pybullet.look import Rgb

WHITE, BLACK, GREY = (235.0, 235.0, 230.0), (28.0, 28.0, 30.0), (140.0, 140.0, 145.0)
RED, GREEN, BLUE = (190.0, 32.0, 34.0), (42.0, 120.0, 52.0), (36.0, 74.0, 160.0)
YELLOW, ORANGE, BROWN = (238.0, 200.0, 40.0), (232.0, 106.0, 28.0), (104.0, 72.0, 44.0)
COLOURS: dict[str, Rgb] = {
    "white": WHITE,
    "black": BLACK,
    "grey": GREY,
    "gray": GREY,
    "red": RED,
    "green": GREEN,
    "blue": BLUE,
    "yellow": YELLOW,
    "orange": ORANGE,
    "brown": BROWN,
}


class Part(NamedTuple):
    """One solid of an object, lengths in units of the object's height."""

    shape: Literal["box", "cylinder", "billboard"]
    forward: float
    left: float
    base: float
    size: tuple[float, float, float]
    rgb: Rgb
    collides: bool = True
    own_colour: bool = False  # takes the colour that the map gives the object


def _box(
    forward: float, left: float, base: float, size: tuple[float, float, float], rgb: Rgb
) -> Part:
    return Part("box", forward, left, base, size, rgb)


def _trim(
    forward: float, left: float, base: float, size: tuple[float, float, float], rgb: Rgb
) -> Part:
    """A box that is only seen: it lies on or in one that collides."""
    return Part("box", forward, left, base, size, rgb, collides=False)


def _drum(base: float, diameter: float, height: float, rgb: Rgb, forward: float = 0.0) -> Part:
    return Part("cylinder", forward, 0.0, base, (diameter, diameter, height), rgb)


def _lamp(base: float, rgb: Rgb) -> Part:
    return Part("billboard", 0.13, 0.0, base, (0.01, 0.1, 0.1), rgb, collides=False)


_CAR_BLUE = (40.0, 90.0, 170.0)
PARTS: dict[str, tuple[Part, ...]] = {
    "floor_tag": (),
    "duckie": (
        _drum(0.0, 0.86, 0.36, YELLOW),
        _drum(0.36, 0.68, 0.12, YELLOW),
        _drum(0.48, 0.54, 0.4, YELLOW, forward=0.12),
        _drum(0.88, 0.38, 0.12, YELLOW, forward=0.12),
        _trim(0.46, 0.0, 0.56, (0.26, 0.24, 0.12), ORANGE),
        _trim(0.37, 0.14, 0.74, (0.06, 0.08, 0.1), BLACK),
        _trim(0.37, -0.14, 0.74, (0.06, 0.08, 0.1), BLACK),
        _trim(-0.42, 0.0, 0.36, (0.2, 0.24, 0.16), YELLOW),
    ),
    "cone": (
        _box(0.0, 0.0, 0.0, (0.72, 0.72, 0.06), ORANGE),
        _drum(0.06, 0.5, 0.2, ORANGE),
        _drum(0.26, 0.4, 0.2, ORANGE),
        _drum(0.46, 0.31, 0.18, WHITE),
        _drum(0.64, 0.22, 0.18, ORANGE),
        _drum(0.82, 0.13, 0.18, ORANGE),
    ),
    "barrier": (
        *(_box(0.0, y, 0.45, (0.14, 0.4, 0.55), RED if i % 2 else WHITE)
          for i, y in enumerate((-0.8, -0.4, 0.0, 0.4, 0.8))),
        _box(0.0, 0.7, 0.0, (0.5, 0.12, 0.45), GREY),
        _box(0.0, -0.7, 0.0, (0.5, 0.12, 0.45), GREY),
    ),
    "tree": (
        _drum(0.0, 0.12, 0.3, BROWN),
        _drum(0.28, 0.56, 0.28, (34.0, 96.0, 44.0)),
        _drum(0.56, 0.42, 0.24, GREEN),
        _drum(0.8, 0.22, 0.2, (54.0, 138.0, 62.0)),
    ),
    "house": (
        _box(0.0, 0.0, 0.0, (1.0, 1.2, 0.62), (214.0, 196.0, 160.0)),
        _box(0.0, 0.0, 0.62, (1.12, 1.32, 0.1), (142.0, 54.0, 44.0)),
        _trim(0.0, 0.0, 0.72, (0.8, 1.32, 0.14), (142.0, 54.0, 44.0)),
        _trim(0.0, 0.0, 0.86, (0.44, 1.32, 0.14), (150.0, 60.0, 48.0)),
        _trim(0.5, 0.0, 0.0, (0.03, 0.2, 0.36), BROWN),
        _trim(0.5, 0.38, 0.26, (0.03, 0.2, 0.2), (120.0, 160.0, 190.0)),
        _trim(0.5, -0.38, 0.26, (0.03, 0.2, 0.2), (120.0, 160.0, 190.0)),
    ),
    "building": (
        _box(0.0, 0.0, 0.0, (0.5, 0.6, 0.94), (166.0, 158.0, 150.0)),
        *(_trim(0.0, 0.0, 0.14 + 0.2 * i, (0.51, 0.61, 0.09), (84.0, 112.0, 138.0))
          for i in range(4)),
        _box(0.0, 0.0, 0.94, (0.54, 0.64, 0.06), GREY),
    ),
    "bus": (
        Part("box", 0.0, 0.0, 0.12, (2.5, 0.86, 0.88), YELLOW, own_colour=True),
        _trim(0.02, 0.0, 0.54, (2.5, 0.88, 0.26), BLACK),
        *(_trim(x, 0.0, 0.0, (0.32, 0.88, 0.3), BLACK) for x in (-0.75, 0.75)),
    ),
    "truck": (
        Part("box", 0.62, 0.0, 0.14, (0.6, 0.8, 0.7), RED, own_colour=True),
        _trim(0.64, 0.0, 0.5, (0.6, 0.82, 0.24), BLACK),
        _box(-0.32, 0.0, 0.2, (1.24, 0.86, 0.8), WHITE),
        *(_trim(x, 0.0, 0.0, (0.3, 0.84, 0.3), BLACK) for x in (-0.65, 0.62)),
    ),
    "duckiebot": (
        Part("box", -0.1, 0.0, 0.2, (1.3, 0.8, 0.3), _CAR_BLUE, own_colour=True),
        _box(-0.15, 0.0, 0.5, (0.8, 0.6, 0.3), (60.0, 62.0, 66.0)),
        _box(0.3, 0.0, 0.5, (0.12, 0.3, 0.5), BLACK),
        _box(0.0, 0.5, 0.0, (0.52, 0.2, 0.52), BLACK),
        _box(0.0, -0.5, 0.0, (0.52, 0.2, 0.52), BLACK),
        _trim(-0.76, 0.0, 0.24, (0.04, 0.76, 0.16), WHITE),
    ),
    "trafficlight": (
        # It hangs over crossings or stands in the way, so nobody collides with one (nor in
        # gym-duckietown 6.1.34, simulator.py, "kind != trafficlight").
        Part("cylinder", 0.0, 0.0, 0.0, (0.07, 0.07, 0.6), GREY, collides=False),
        _trim(0.05, 0.0, 0.56, (0.14, 0.18, 0.44), BLACK),
        _lamp(0.86, (84.0, 22.0, 22.0)),
        _lamp(0.73, (92.0, 72.0, 20.0)),
        _lamp(0.6, (40.0, 220.0, 80.0)),
    ),
    "checkerboard": (
        _box(0.0, 0.0, 0.0, (0.03, 1.3, 1.0), WHITE),
        *(_trim(0.01, -0.5 + 0.2 * column, 0.1 + 0.2 * row, (0.03, 0.2, 0.2), BLACK)
          for row in range(4) for column in range(row % 2, 6, 2)),
    ),
}  # fmt: skip
CLASSES: dict[str, SemanticClass] = {
    "duckie": SemanticClass.PERSON,
    "bus": SemanticClass.VEHICLE,
    "truck": SemanticClass.VEHICLE,
    "duckiebot": SemanticClass.VEHICLE,
    "trafficlight": SemanticClass.SIGN,
}

# Colour of the field on each sign's white plate.
SIGN_FACES: dict[str, Rgb] = {
    "stop": RED,
    "do_not_enter": RED,
    "yield": RED,
    "no_left_turn": RED,
    "no_right_turn": RED,
    "oneway_left": BLACK,
    "oneway_right": BLACK,
    "blank": WHITE,
    **dict.fromkeys(
        ("4_way_intersect", "T_intersect", "left_T_intersect", "right_T_intersect", "pedestrian",
         "t_light_ahead", "duck_crossing"),
        YELLOW,
    ),
}  # fmt: skip


def sign_parts(face: str) -> tuple[Part, ...]:
    """A post in a foot, a white plate, the sign's field above and its black tag below."""
    return (
        _box(0.0, 0.0, 0.0, (0.3, 0.3, 0.05), GREEN),
        _box(0.0, 0.0, 0.05, (0.05, 0.05, 0.4), BROWN),
        _box(0.0, 0.0, 0.36, (0.03, 0.42, 0.64), WHITE),
        _trim(0.01, 0.0, 0.68, (0.03, 0.3, 0.28), SIGN_FACES[face]),
        _trim(0.01, 0.0, 0.4, (0.03, 0.24, 0.24), BLACK),
    )
