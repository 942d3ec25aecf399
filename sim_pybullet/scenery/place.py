"""What there is to drive on: a Duckietown map or a race track, painted and built alike."""

from __future__ import annotations

import numpy as np

from robot.navigation.road_map import RoadMap
from sim_pybullet.look import Look
from sim_pybullet.painting.ground import paint_ground
from sim_pybullet.racing.track import Track
from sim_pybullet.racing.track_ground import paint_track
from sim_pybullet.racing.track_walls import track_walls
from sim_pybullet.scene import Ground, Scene, Solid
from sim_pybullet.scenery.clutter import clutter_solids
from sim_pybullet.scenery.objects import standing_solids

Place = RoadMap | Track


def paint_place(place: Place, look: Look) -> Ground:
    """The floor of a map or a track."""
    return (
        paint_track(place, look) if isinstance(place, Track) else paint_ground(place, look.ground)
    )


def place_solids(place: Place, look: Look, rng: np.random.Generator) -> tuple[Solid, ...]:
    """What stands there in an episode; ``rng`` picks a map's optional objects and its clutter."""
    if isinstance(place, Track):
        return track_walls(place, look)
    return standing_solids(place, rng) + clutter_solids(place, look.clutter, rng)


def place_scene(place: Place, look: Look, rng: np.random.Generator) -> Scene:
    """Everything that there is to see."""
    solids = place_solids(place, look, rng)
    return Scene(paint_place(place, look), solids, look.sky, look.light)
