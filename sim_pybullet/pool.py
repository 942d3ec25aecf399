"""``LookPool``: painted worlds that episodes share, since painting a floor takes far longer than
driving a step."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from weakref import WeakValueDictionary

import numpy as np

from robot.errors import ConfigError
from sim_pybullet.look import GroundLook, Look, TrackLook
from sim_pybullet.randomise import Sampler, fixed, one_site
from sim_pybullet.scene import Ground, Scene
from sim_pybullet.scenery.objects import Place, paint_place, place_solids

Looks = Sequence[Look] | Sampler


@dataclass(frozen=True)
class PaintedWorld:
    """A map as one Look paints it, and where that Look comes from."""

    scene: Scene
    look: Look
    site: Sampler  # of the Looks of episodes here

    def episode_look(self, rng: np.random.Generator) -> Look:
        """A Look of the site whose paint and camera are those of this world."""
        painted = self.look
        return replace(
            self.site(rng),
            ground=painted.ground,
            track=painted.track,
            sky=painted.sky,
            light=painted.light,
            clutter=painted.clutter,
            camera=painted.camera,
        )


# Floors that some pool of this process still uses: a training's two worlds, the one it learns in
# and the one it is judged in, are of the same seed and paint the same ones.
_FLOORS: WeakValueDictionary[tuple[Place, GroundLook, TrackLook], Ground] = WeakValueDictionary()


def paint_world(place: Place, looks: Looks, rng: np.random.Generator) -> PaintedWorld:
    """A map or track in a Look drawn from a sampler or a list; equal paint is the same object."""
    site = one_site(looks, rng) if callable(looks) else fixed(looks[int(rng.integers(len(looks)))])
    look = site(rng)
    solids = place_solids(place, look, rng)
    key = (place, look.ground, look.track)
    floor = _FLOORS.get(key)
    if floor is None:
        floor = _FLOORS[key] = paint_place(place, look)
    return PaintedWorld(Scene(floor, solids, look.sky, look.light), look, site)


class LookPool:
    """``size`` painted worlds of each map, drawn from at random when an episode begins.

    With a list of Looks every map is painted in each of them, and an episode has one Look of the
    list. With a sampler an episode takes floor, clutter, sky, light and camera from a painted world
    and everything else from a Look of its own, of the same site where the sampler has several:
    what one file says of floor, camera, sensor, drive and timing belongs together.

    Raises:
        ConfigError: an empty list, or a size below 1.
    """

    def __init__(
        self, road_maps: Sequence[Place], looks: Looks, rng: np.random.Generator, size: int = 16
    ) -> None:
        self._size = size if callable(looks) else len(looks)
        if self._size < 1:
            raise ConfigError("LookPool: expected at least one Look and a size of 1 or more")
        each = [looks if callable(looks) else [looks[k]] for k in range(self._size)]
        self.worlds = tuple(paint_world(m, one, rng) for m in road_maps for one in each)

    def draw(self, map_index: int, rng: np.random.Generator) -> tuple[int, Look]:
        """A painted world of a map (index into ``worlds``), and the Look of an episode in it."""
        index = map_index * self._size + int(rng.integers(self._size))
        return index, self.worlds[index].episode_look(rng)
