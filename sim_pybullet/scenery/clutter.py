"""Boxes and people around the road, so that no policy learns what a room looks like, and things on
and beside the road, so that none takes them for its lines."""

import math
from functools import partial

import numpy as np

from robot.navigation.map_objects import MapObject, colours, kinds
from robot.navigation.road_map import RoadMap
from sim_pybullet.look import ClutterLook, Rgb
from sim_pybullet.scene import Solid

_MARGIN_M = 1.2  # how far beyond the map things stand
_BOX_M = ((0.1, 0.1, 0.08), (0.7, 0.7, 0.8))  # smallest and largest length, width, height
_TRIES = 20  # for a place that is not on the road
# What stands by the road: its share, its kind (signs show any face), its height [m], and how far to
# the right of a lane's middle it stands [m]. Ducks are low enough to be driven through unnoticed.
_ROADSIDE = (
    (0.5, "duckie", (0.04, 0.08), (-0.45, 0.4)),
    (0.3, "sign", (0.12, 0.2), (0.17, 0.35)),
    (0.08, "duckiebot", (0.11, 0.14), (-0.3, -0.18)),
    (0.04, "cone", (0.05, 0.12), (0.17, 0.35)),
    (0.04, "house", (0.2, 0.5), (0.35, 0.6)),
    (0.04, "tree", (0.1, 0.4), (0.2, 0.5)),
)


def clutter_solids(
    road_map: RoadMap, look: ClutterLook, rng: np.random.Generator
) -> tuple[Solid, ...]:
    """Boxes, and people of two legs, a body and a head, none of them on the road."""
    solids: list[Solid] = []
    for _ in range(look.boxes):
        length, width, height = (float(size) for size in rng.uniform(*_BOX_M))
        place = _place(road_map, 0.5 * math.hypot(length, width), rng)
        if place is not None:
            heading, size = rng.uniform(-math.pi, math.pi), (length, width, height)
            solids.append(Solid("box", *place, heading, size, _colour(rng), collides=False))
    for _ in range(look.people):
        place = _place(road_map, 0.25, rng)
        if place is not None:
            solids += _person(*place, rng)
    return tuple(solids)


def roadside(road_map: RoadMap, count: int, rng: np.random.Generator) -> tuple[MapObject, ...]:
    """So many things on and beside the road, by its lanes."""
    found, shares = [], [share for share, *_ in _ROADSIDE]
    signs, rgb = [kind for kind in kinds() if kind.startswith("sign_")], list(colours())
    for number in range(count if road_map.lanes else 0):
        _, kind, heights_m, right_m = _ROADSIDE[int(rng.choice(len(shares), p=shares))]
        lane = road_map.lanes[int(rng.integers(len(road_map.lanes)))]
        (x_m, y_m, ahead), aside_m = lane.pose_at(rng.uniform()), rng.uniform(*right_m)
        turned = 0.0 if kind == "duckiebot" else rng.uniform(-math.pi, math.pi)
        if kind == "sign":
            kind, turned = signs[int(rng.integers(len(signs)))], rng.uniform(2.4, 3.9)
        x_m, y_m = x_m + aside_m * math.sin(ahead), y_m - aside_m * math.cos(ahead)
        colour, height_m = rgb[int(rng.integers(len(rgb)))], float(rng.uniform(*heights_m))
        name = f"thing {number}"
        found.append(MapObject(name, kind, x_m, y_m, ahead + turned, height_m, color=colour))
    return tuple(found)


def _person(x_m: float, y_m: float, rng: np.random.Generator) -> list[Solid]:
    heading, height = rng.uniform(-math.pi, math.pi), rng.uniform(1.5, 1.9)
    part = partial(Solid, "cylinder", heading_rad=heading, collides=False)
    dx, dy = -0.1 * math.sin(heading), 0.1 * math.cos(heading)
    trousers, shirt = _colour(rng), _colour(rng)
    skin = float(rng.uniform(0.35, 1.0))
    rgb = (230.0 * skin, 190.0 * skin, 160.0 * skin)
    leg, body, head = (0.14, 0.14, 0.5 * height), (0.3, 0.3, 0.36 * height), (0.18, 0.18, 0.2)
    return [
        part(x_m - dx, y_m - dy, size_m=leg, rgb=trousers),
        part(x_m + dx, y_m + dy, size_m=leg, rgb=trousers),
        part(x_m, y_m, size_m=body, rgb=shirt, base_m=0.5 * height),
        part(x_m, y_m, size_m=head, rgb=rgb, base_m=0.86 * height),
    ]


def _place(town: RoadMap, radius_m: float, rng: np.random.Generator) -> tuple[float, float] | None:
    """Somewhere on or around the map where a disc touches no road; None where none was found."""
    low = np.full(2, -_MARGIN_M)
    high = np.array((town.width_m, town.height_m)) + _MARGIN_M
    around = radius_m * np.array([(math.cos(a), math.sin(a)) for a in np.arange(8) * math.pi / 4])
    for _ in range(_TRIES):
        place = rng.uniform(low, high)
        if not any(town.on_road(*point) for point in (*(place + around), place)):
            return float(place[0]), float(place[1])
    return None


def _colour(rng: np.random.Generator) -> Rgb:
    red, green, blue = rng.uniform(15.0, 235.0) + rng.uniform(-60.0, 60.0, 3)
    return tuple(min(255.0, max(0.0, float(v))) for v in (red, green, blue))  # type: ignore[return-value]
