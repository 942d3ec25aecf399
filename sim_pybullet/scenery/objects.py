"""Things on a map as simple solids, and the whole ``Scene`` of a map under a Look."""

from __future__ import annotations

import math

import numpy as np

from robot.errors import MapError, nearest
from robot.navigation.road_map import RoadMap
from sim_pybullet.classes import SemanticClass
from sim_pybullet.look import Look, Rgb
from sim_pybullet.painting.ground import paint_ground
from sim_pybullet.scene import Scene, Solid
from sim_pybullet.scenery.clutter import clutter_solids
from sim_pybullet.scenery.map_objects import MapObject, objects_of
from sim_pybullet.scenery.object_parts import CLASSES, COLOURS, PARTS, SIGN_FACES, Part, sign_parts

OPTIONAL_SHARE = 0.5  # probability that an optional object stands there in an episode


def build_scene(road_map: RoadMap, look: Look, rng: np.random.Generator) -> Scene:
    """The floor, the objects, the clutter, sky and light of a map.

    ``rng`` decides which optional objects are there and where the clutter is; the rest
    follows from map and Look.

    Raises:
        MapError: an object of a kind that nobody can draw, with the nearest one.
    """
    ground = paint_ground(road_map, look.ground)
    solids = standing_solids(road_map, rng) + clutter_solids(road_map, look.clutter, rng)
    return Scene(ground, solids, look.sky, look.light)


def standing_solids(road_map: RoadMap, rng: np.random.Generator) -> tuple[Solid, ...]:
    """The solids of all objects that stand there in an episode; ``rng`` picks the optional ones."""
    solids: list[Solid] = []
    for item in objects_of(road_map):
        if not item.optional or rng.random() < OPTIONAL_SHARE:
            solids += object_solids(item)
    return tuple(solids)


def object_solids(item: MapObject) -> tuple[Solid, ...]:
    """The solids that one object of a map is made of; none for marks on the floor."""
    face = item.kind.removeprefix("sign_")
    if face != item.kind and face in SIGN_FACES:
        kind, parts = SemanticClass.SIGN, sign_parts(face)
    elif item.kind in PARTS:
        kind, parts = CLASSES.get(item.kind, SemanticClass.OBJECT), PARTS[item.kind]
    else:
        valid = (*PARTS, *(f"sign_{face}" for face in SIGN_FACES))
        raise MapError(
            f"object {item.name}: unknown kind {item.kind!r}; {nearest(item.kind, valid)}"
        )
    return tuple(_solid(item, part, kind) for part in parts)


def _solid(item: MapObject, part: Part, kind: SemanticClass) -> Solid:
    scale = item.height_m
    c, s = math.cos(item.heading_rad), math.sin(item.heading_rad)
    return Solid(
        shape=part.shape,
        x_m=item.x_m + scale * (c * part.forward - s * part.left),
        y_m=item.y_m + scale * (s * part.forward + c * part.left),
        heading_rad=item.heading_rad,
        size_m=(scale * part.size[0], scale * part.size[1], scale * part.size[2]),
        rgb=_colour(item, part),
        kind=kind,
        base_m=scale * part.base,
        collides=part.collides,
    )


def _colour(item: MapObject, part: Part) -> Rgb:
    """The map's colour on the parts that carry the object's own colour."""
    return COLOURS.get(item.color or "", part.rgb) if part.own_colour else part.rgb
