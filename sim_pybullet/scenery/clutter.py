"""Boxes and people around the road, so that no policy learns what a room looks like."""

from __future__ import annotations

import math

import numpy as np

from robot.navigation.road_map import RoadMap
from sim_pybullet.classes import SemanticClass
from sim_pybullet.look import ClutterLook, Rgb
from sim_pybullet.scene import Solid

_MARGIN_M = 1.2  # how far beyond the map things stand
_BOX_M = ((0.1, 0.1, 0.08), (0.7, 0.7, 0.8))  # smallest and largest length, width, height
_TRIES = 20  # for a place that is not on the road


def clutter_solids(
    road_map: RoadMap, look: ClutterLook, rng: np.random.Generator
) -> tuple[Solid, ...]:
    """Boxes, and people of two legs, a body and a head, none of them on the road."""
    solids: list[Solid] = []
    for _ in range(look.boxes):
        length, width, height = (float(size) for size in rng.uniform(*_BOX_M))
        place = _place(road_map, 0.5 * math.hypot(length, width), rng)
        if place is not None:
            heading = rng.uniform(-math.pi, math.pi)
            size = (length, width, height)
            solids.append(_thing("box", place, heading, size, _colour(rng)))
    for _ in range(look.people):
        place = _place(road_map, 0.25, rng)
        if place is not None:
            solids += _person(place, rng)
    return tuple(solids)


def _person(place: np.ndarray, rng: np.random.Generator) -> list[Solid]:
    heading, height = rng.uniform(-math.pi, math.pi), rng.uniform(1.5, 1.9)
    aside = 0.1 * np.array((-math.sin(heading), math.cos(heading)))
    trousers, shirt = _colour(rng), _colour(rng)
    leg, body, head = (0.14, 0.14, 0.5 * height), (0.3, 0.3, 0.36 * height), (0.18, 0.18, 0.2)
    parts = [_thing("cylinder", place + side * aside, heading, leg, trousers) for side in (-1, 1)]
    parts.append(_thing("cylinder", place, heading, body, shirt, 0.5 * height))
    skin = float(rng.uniform(0.35, 1.0))
    rgb = (230.0 * skin, 190.0 * skin, 160.0 * skin)
    parts.append(_thing("cylinder", place, heading, head, rgb, 0.86 * height))
    return parts


def _thing(
    shape: str,
    place: np.ndarray,
    heading_rad: float,
    size_m: tuple[float, float, float],
    rgb: Rgb,
    base_m: float = 0.0,
) -> Solid:
    return Solid(
        "box" if shape == "box" else "cylinder",
        float(place[0]),
        float(place[1]),
        heading_rad,
        size_m,
        rgb,
        SemanticClass.OBJECT,
        base_m,
        collides=False,
    )


def _place(road_map: RoadMap, radius_m: float, rng: np.random.Generator) -> np.ndarray | None:
    """Somewhere on or around the map where a disc touches no road; None where none was found."""
    low = np.full(2, -_MARGIN_M)
    high = np.array((road_map.width_m, road_map.height_m)) + _MARGIN_M
    around = radius_m * np.array([(math.cos(a), math.sin(a)) for a in np.arange(8) * math.pi / 4])
    for _ in range(_TRIES):
        place = rng.uniform(low, high)
        if not any(road_map.on_road(*point) for point in (*(place + around), place)):
            return np.asarray(place)
    return None


def _colour(rng: np.random.Generator) -> Rgb:
    red, green, blue = rng.uniform(15.0, 235.0) + rng.uniform(-60.0, 60.0, 3)
    return tuple(min(255.0, max(0.0, float(v))) for v in (red, green, blue))  # type: ignore[return-value]
