"""Where the episodes of a batch come from: drawn one after the other, or numbered.

A training draws: all robots share random numbers and a pool of painted worlds, since painting a
floor takes far longer than driving a step. An evaluation numbers: whatever is random in an episode
follows from the seed and its number alone, so it is the same whichever others are driven, and no
robot drives that nobody asked for.

Robots that share a world, a group, begin their episodes together. In a training they end them
together as well; in an evaluation who has ended stays where it is until the others have.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, cast
from weakref import WeakValueDictionary

import numpy as np

from robot.errors import ConfigError
from sim_pybullet.look import NOMINAL, GroundLook, Look, TrackLook
from sim_pybullet.randomise import Sampler, fixed, one_site
from sim_pybullet.scene import Ground, Scene, Solid
from sim_pybullet.scenery.objects import Place, paint_place, place_solids
from sim_pybullet.tasks.spec import Task, TaskStep

Looks = Sequence[Look] | Sampler


@dataclass(frozen=True)
class PaintedWorld:
    """A map as one Look paints it, and where that Look comes from."""

    scene: Scene
    look: Look
    site: Sampler  # of the Looks of episodes here

    def episode_look(self, rng: np.random.Generator) -> Look:
        """A Look of the site whose paint and camera are those of this world."""
        own = self.site(rng)
        return replace(
            self.look, sensor=own.sensor, drive=own.drive, timing=own.timing, pose=own.pose
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

    ConfigError for an empty list, or a size below 1.
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


KINDS = ("task", "look", "motor", "skip", "noise", "pose")  # of random numbers
EPISODES_OF_A_WORLD = 4  # on one map: paint is shared, everything else is an episode's own
Setting = tuple[int, PaintedWorld, Look]  # a world of the town, as painted, and an episode's Look


def _streams(seed: int | tuple[int, int]) -> dict[str, np.random.Generator]:
    streams = np.random.SeedSequence(seed).spawn(len(KINDS))
    return {k: np.random.default_rng(s) for k, s in zip(KINDS, streams, strict=True)}


class DrawnEpisodes:
    """Episodes without end, from random numbers that all robots share."""

    def __init__(
        self, road_maps: Sequence[Place], looks: Looks, n: int, seed: int, size: int, group: int = 1
    ) -> None:
        self._group, self._worlds = group, np.zeros(n, dtype=int)
        self._pool = LookPool(road_maps, looks, np.random.default_rng(seed), size)
        # What stands in each world of the town before the first episode.
        self.solids: Sequence[Sequence[Solid]] = [w.scene.solids for w in self._pool.worlds]
        self.reach_m = 0.0  # from the origin of their worlds solids may lie that come later
        self.numbers = np.zeros(n, dtype=int)  # of episodes; below 0: none is left, it has ended
        self.seed(seed)

    def seed(self, seed: int) -> None:
        """Begin the random numbers anew; the painted worlds stay as they are."""
        self._rngs = _streams(seed)

    def begin(self, robots: np.ndarray) -> np.ndarray:
        """These robots (M,) want their next episode; those who get one."""
        return robots

    def together(self, step: TaskStep) -> TaskStep:
        """A step as judged, with what it means for the others of a group."""
        ended = (step.terminated | step.truncated).reshape(-1, self._group).any(axis=1)
        return step._replace(truncated=np.repeat(ended, self._group) & ~step.terminated)

    def starts(self, task: Task, robots: np.ndarray) -> np.ndarray:
        """The poses (M, 3) at which they begin it."""
        return task.reset(robots, self._rngs["task"])

    def setting(self, robot: int, map_index: int) -> Setting:
        """And in which world."""
        rng = self._rngs["look"]
        if robot % self._group:
            world = self._worlds[robot] = self._worlds[robot - 1]
            look = self._pool.worlds[world].episode_look(rng)
        else:
            world, look = self._pool.draw(map_index, rng)
            self._worlds[robot] = world
        return int(world), self._pool.worlds[world], look

    def rng(self, kind: str, robots: np.ndarray | None = None) -> np.random.Generator:  # noqa: ARG002
        """Random numbers of a kind whose first axis are the robots: all, or these."""
        return self._rngs[kind]

    def own(self, kind: str, robot: int) -> np.random.Generator:  # noqa: ARG002
        """Random numbers of a kind for one robot."""
        return self._rngs[kind]


class NumberedEpisodes:
    """As `DrawnEpisodes`, one of each number for the robot in its place, with a world for itself.

    Consecutive numbers go through the maps in turn; of one map, `EPISODES_OF_A_WORLD` share paint.
    """

    def __init__(
        self,
        road_maps: Sequence[Place],
        looks: Looks,
        n: int,
        seed: int,
        numbers: Sequence[int],
        group: int = 1,
    ) -> None:
        if len(numbers) != n:
            raise ConfigError(f"episodes: expected {n}, one for each robot, got {len(numbers)}")
        self._group = group
        self._road_maps, self._looks, self._begun = tuple(road_maps), looks, False
        self.numbers = np.array(numbers)
        self.solids: Sequence[Sequence[Solid]] = [()] * n
        self.seed(seed)
        self._painted: dict[tuple[int, int], PaintedWorld] = {}
        rng = np.random.default_rng(0)
        standing = [s for place in road_maps for s in place_solids(place, NOMINAL, rng)]
        self.reach_m = 2.0 * max((abs(solid.x_m) for solid in standing), default=0.0)

    def seed(self, seed: int) -> None:
        """Before the episodes have begun."""
        self._seed = seed
        self._rngs = [_streams((seed, number)) for number in self.numbers.tolist()]

    def begin(self, robots: np.ndarray) -> np.ndarray:
        """All at first; whoever wants another has ended."""
        if self._begun:
            self.numbers[robots] = -1
            return robots[:0]
        self._begun = True
        return robots

    def together(self, step: TaskStep) -> TaskStep:
        """As it is."""
        return step

    def starts(self, task: Task, robots: np.ndarray) -> np.ndarray:
        """Where they begin."""
        each = [
            task.reset(group, self.own("task", group[0]), self.numbers[group[0]] // self._group)
            for group in robots.reshape(-1, self._group)
        ]
        return np.concatenate(each)

    def setting(self, robot: int, map_index: int) -> Setting:
        """The robot's own world, painted as that of its number."""
        first = robot - robot % self._group
        number = int(self.numbers[first]) // self._group
        block = number // (len(self._road_maps) * EPISODES_OF_A_WORLD)
        key = (map_index, block)
        if key not in self._painted:
            rng = np.random.default_rng((self._seed, map_index, block))
            self._painted[key] = paint_world(self._road_maps[map_index], self._looks, rng)
        painted = self._painted[key]
        return first, painted, painted.episode_look(self.own("look", robot))

    def rng(self, kind: str, robots: np.ndarray | None = None) -> np.random.Generator:
        """Each robot draws from its own generator."""
        chosen = range(len(self._rngs)) if robots is None else robots.tolist()
        return cast(np.random.Generator, RobotRngs([self._rngs[i][kind] for i in chosen]))

    def own(self, kind: str, robot: int) -> np.random.Generator:
        """One robot's."""
        return self._rngs[robot][kind]


class RobotRngs:
    """The generators of M robots as one: row i of what is drawn comes from robot i's.

    The last argument of what is called is the size, M or (M, ...).
    """

    def __init__(self, rngs: Sequence[np.random.Generator]) -> None:
        self._rngs = rngs

    def __getattr__(self, name: str) -> Any:
        def draw(*arguments: Any) -> np.ndarray:
            *others, size = arguments
            each = () if isinstance(size, int) else size[1:]
            return np.array([getattr(rng, name)(*others, each) for rng in self._rngs])

        return draw
