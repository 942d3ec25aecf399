"""What there is to see: a Duckietown map or a race track, painted and built alike under a Look."""

from dataclasses import replace

import numpy as np

from robot.errors import MapError
from robot.navigation.map_objects import objects_of
from robot.navigation.road_map import RoadMap
from sim_pybullet.look import Look
from sim_pybullet.painting.ground import paint_ground
from sim_pybullet.racing.track import Track, centre_line
from sim_pybullet.racing.track_ground import paint_track, track_walls
from sim_pybullet.scene import Ground, Scene, Solid
from sim_pybullet.scenery.clutter import clutter_solids, roadside
from sim_pybullet.scenery.object_solids import object_solids

Place = RoadMap | Track  # what there is to drive on
OPTIONAL_SHARE = 0.5  # probability that an optional object stands there in an episode


def lane_poses(place: Place, count: int, rng: np.random.Generator) -> np.ndarray:
    """(count, 3) poses along random lanes, or the road of a track; MapError without any."""
    if isinstance(place, Track):
        path = centre_line(place).path
        arcs_m = rng.uniform(0.0, path.length_m, count)
        return np.array([path.pose_at(arc_m) for arc_m in arcs_m.tolist()])
    if not place.lanes:
        raise MapError(f"{place.name}: expected a map with roads, got none; try --map town")
    lanes = rng.integers(len(place.lanes), size=count).tolist()
    return np.array([place.lanes[k].pose_at(rng.uniform()) for k in lanes])


def build_scene(place: Place, look: Look, rng: np.random.Generator) -> Scene:
    """The floor, what stands on it, sky and light; ``rng`` as of `place_solids`."""
    return Scene(paint_place(place, look), place_solids(place, look, rng), look.sky, look.light)


def paint_place(place: Place, look: Look) -> Ground:
    """The floor of a map or a track."""
    return (
        paint_track(place, look) if isinstance(place, Track) else paint_ground(place, look.ground)
    )


def place_solids(place: Place, look: Look, rng: np.random.Generator) -> tuple[Solid, ...]:
    """What stands there in an episode; ``rng`` picks a map's optional objects and its clutter."""
    if isinstance(place, Track):
        return track_walls(place, look)
    solids: list[Solid] = []
    for item in objects_of(place):
        if not item.optional or rng.random() < OPTIONAL_SHARE:
            solids += object_solids(item)
    solids += clutter_solids(place, look.clutter, rng)
    for item in roadside(place, look.clutter.things, rng):
        solids += [replace(solid, collides=False) for solid in object_solids(item)]
    return tuple(solids)
