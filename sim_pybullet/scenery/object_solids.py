"""What is to be seen of a map's objects."""

import math

from robot.navigation.map_objects import MapObject, colours, kinds
from sim_pybullet.scene import SemanticClass, Solid


def object_solids(item: MapObject) -> tuple[Solid, ...]:
    """The solids that one object of a map is made of; none for marks on the floor."""
    kind = kinds()[item.kind]
    scale = item.height_m
    c, s = math.cos(item.heading_rad), math.sin(item.heading_rad)
    return tuple(
        Solid(
            shape=part.shape,
            x_m=item.x_m + scale * (c * part.forward - s * part.left),
            y_m=item.y_m + scale * (s * part.forward + c * part.left),
            heading_rad=item.heading_rad,
            size_m=(scale * part.size[0], scale * part.size[1], scale * part.size[2]),
            rgb=colours().get(item.color or "", part.rgb) if part.own_colour else part.rgb,
            kind=SemanticClass[kind.class_name],
            base_m=scale * part.base,
            collides=part.collides,
        )
        for part in kind.parts
    )
