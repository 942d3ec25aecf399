"""Where the episodes of a batch come from: drawn one after the other, or numbered.

A training draws: all robots share random numbers and a pool of painted worlds, which is fast. An
evaluation numbers: whatever is random in an episode follows from the seed and its number alone, so
it is the same whichever others are driven, and no robot drives that nobody asked for.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple, Protocol, cast

import numpy as np

from sim_pybullet.look import NOMINAL, Look
from sim_pybullet.pool import LookPool, Looks, PaintedWorld, paint_world
from sim_pybullet.scene import Solid
from sim_pybullet.scenery.place import Place, place_solids
from sim_pybullet.tasks.base import Starts, Task

Size = int | tuple[int, ...]  # of what is drawn for M robots: M, or (M, ...)
KINDS = ("task", "look", "motor", "skip", "noise", "pose")  # of random numbers
EPISODES_OF_A_WORLD = 4  # on one map: paint is shared, everything else is an episode's own
_KEPT = 3  # painted worlds of a map: numbers are begun in order, so older ones are done with


class Setting(NamedTuple):
    """Where an episode takes place: which world of the town, as painted, and its Look."""

    world: int
    painted: PaintedWorld
    look: Look


class Episodes(Protocol):
    """Begins the episodes of N robots."""

    @property
    def solids(self) -> Sequence[Sequence[Solid]]:
        """What stands in each world of the town before the first episode."""

    @property
    def reach_m(self) -> float:
        """How far from the origin of their worlds solids may lie that come later [m]."""

    @property
    def numbers(self) -> np.ndarray:
        """(N,) int, of each robot's episode; below 0: none is left for it, and it has ended."""

    def begin(self, robots: np.ndarray) -> np.ndarray:
        """These robots (M,) want their next episode; those of them who get one."""

    def starts(self, task: Task, robots: np.ndarray) -> Starts:
        """Where they begin it."""

    def setting(self, robot: int, map_index: int) -> Setting:
        """And in which world."""

    def rng(self, kind: str, robots: np.ndarray | None = None) -> np.random.Generator:
        """Random numbers of a kind whose first axis are the robots: all, or these."""

    def own(self, kind: str, robot: int) -> np.random.Generator:
        """Random numbers of a kind for one robot."""

    def seed(self, seed: int) -> None:
        """Begin the random numbers anew; the painted worlds stay as they are."""


class DrawnEpisodes:
    """Episodes without end, from random numbers that all robots share."""

    reach_m = 0.0  # none come later

    def __init__(self, road_maps: Sequence[Place], looks: Looks, n: int, seed: int, size: int):
        self._pool = LookPool(road_maps, looks, np.random.default_rng(seed), size)
        self.numbers = np.zeros(n, dtype=int)
        self.seed(seed)

    @property
    def solids(self) -> Sequence[Sequence[Solid]]:
        """As of `Episodes`: each painted world is one of the town."""
        return [world.scene.solids for world in self._pool.worlds]

    def begin(self, robots: np.ndarray) -> np.ndarray:
        """All of them."""
        return robots

    def starts(self, task: Task, robots: np.ndarray) -> Starts:
        """As of `Episodes`."""
        return task.reset(robots, self._rngs["task"])

    def setting(self, robot: int, map_index: int) -> Setting:  # noqa: ARG002
        """A world of the pool."""
        world, look = self._pool.draw(map_index, self._rngs["look"])
        return Setting(world, self._pool.worlds[world], look)

    def rng(self, kind: str, robots: np.ndarray | None = None) -> np.random.Generator:  # noqa: ARG002
        """As of `Episodes`."""
        return self._rngs[kind]

    def own(self, kind: str, robot: int) -> np.random.Generator:  # noqa: ARG002
        """As of `Episodes`."""
        return self._rngs[kind]

    def seed(self, seed: int) -> None:
        """As of `Episodes`."""
        streams = np.random.SeedSequence(seed).spawn(len(KINDS))
        self._rngs = {k: np.random.default_rng(s) for k, s in zip(KINDS, streams, strict=True)}


class NumberedEpisodes:
    """Episodes of these numbers, in this order; each robot has a world of the town for itself.

    Consecutive numbers go through the maps in turn; of one map, `EPISODES_OF_A_WORLD` share paint.
    """

    def __init__(
        self, road_maps: Sequence[Place], looks: Looks, n: int, seed: int, numbers: Sequence[int]
    ) -> None:
        self._road_maps, self._looks, self._seed = tuple(road_maps), looks, seed
        self._waiting = iter(numbers)
        self.numbers = np.full(n, -1)
        self._rngs = {kind: [np.random.default_rng(0)] * n for kind in KINDS}
        self._painted: dict[tuple[int, int], PaintedWorld] = {}
        rng = np.random.default_rng(0)
        standing = [s for place in road_maps for s in place_solids(place, NOMINAL, rng)]
        self.reach_m = 2.0 * max((abs(solid.x_m) for solid in standing), default=0.0)

    @property
    def solids(self) -> Sequence[Sequence[Solid]]:
        """As of `Episodes`: N empty worlds."""
        return [()] * len(self.numbers)

    def begin(self, robots: np.ndarray) -> np.ndarray:
        """The next numbers, as long as there are any."""
        for robot in robots.tolist():
            number = next(self._waiting, -1)
            self.numbers[robot] = number
            if number >= 0:
                streams = np.random.SeedSequence((self._seed, number)).spawn(len(KINDS))
                for kind, stream in zip(KINDS, streams, strict=True):
                    self._rngs[kind][robot] = np.random.default_rng(stream)
        return robots[self.numbers[robots] >= 0]

    def starts(self, task: Task, robots: np.ndarray) -> Starts:
        """As of `Episodes`."""
        each = [
            task.reset(robots[k : k + 1], self._rngs["task"][robot], self.numbers[robot])
            for k, robot in enumerate(robots.tolist())
        ]
        return Starts(*(np.concatenate(parts) for parts in zip(*each, strict=True)))

    def setting(self, robot: int, map_index: int) -> Setting:
        """The robot's own world, painted as that of its number."""
        painted = self._world(map_index, int(self.numbers[robot]))
        return Setting(robot, painted, painted.episode_look(self._rngs["look"][robot]))

    def rng(self, kind: str, robots: np.ndarray | None = None) -> np.random.Generator:
        """Each robot draws from its own generator."""
        rngs = self._rngs[kind]
        own = rngs if robots is None else [rngs[robot] for robot in robots.tolist()]
        return cast(np.random.Generator, RobotRngs(own))

    def own(self, kind: str, robot: int) -> np.random.Generator:
        """As of `Episodes`."""
        return self._rngs[kind][robot]

    def seed(self, seed: int) -> None:
        """For the episodes that have not begun."""
        self._seed = seed

    def _world(self, map_index: int, number: int) -> PaintedWorld:
        block = number // (len(self._road_maps) * EPISODES_OF_A_WORLD)
        key = (map_index, block)
        if key not in self._painted:
            rng = np.random.default_rng((self._seed, map_index, block))
            self._painted[key] = paint_world(self._road_maps[map_index], self._looks, rng)
            for old in [k for k in self._painted if k[0] == map_index][:-_KEPT]:
                del self._painted[old]
        return self._painted[key]


class RobotRngs:
    """The generators of M robots as one: row i of what is drawn comes from robot i's.

    Has what vehicles, cameras and pose errors draw, and nothing else.
    """

    def __init__(self, rngs: Sequence[np.random.Generator]) -> None:
        self._rngs = rngs

    def standard_normal(self, size: Size) -> np.ndarray:
        """(M, ...)."""
        return np.array([rng.standard_normal(_of_one(size)) for rng in self._rngs])

    def random(self, size: Size) -> np.ndarray:
        """(M, ...) in [0, 1)."""
        return np.array([rng.random(_of_one(size)) for rng in self._rngs])

    def uniform(self, low: float, high: float, size: Size) -> np.ndarray:
        """(M, ...) in [low, high)."""
        return np.array([rng.uniform(low, high, _of_one(size)) for rng in self._rngs])

    def integers(self, low: int, high: int, size: Size) -> np.ndarray:
        """(M, ...) in [low, high)."""
        return np.array([rng.integers(low, high, _of_one(size)) for rng in self._rngs])


def _of_one(size: Size) -> tuple[int, ...]:
    return () if isinstance(size, int) else size[1:]
