"""``Crowd``: all road users of G worlds, what each robot of ours has ahead, and who has the way."""

from enum import IntEnum
from typing import NamedTuple

import numpy as np

from robot.contract import CONTROL_DT_S
from robot.errors import MapError
from robot.geometry import wrap_angle
from robot.navigation.map_objects import HALF_ROBOT_M, MapObject
from robot.navigation.path import PathBatch
from sim_pybullet.scene import Mover
from sim_pybullet.scenery.object_solids import object_solids
from sim_pybullet.traffic import drivers, ducks
from sim_pybullet.traffic.ahead import AHEAD_M, NOTHING, STEP_M, meeting, nearest
from sim_pybullet.traffic.drivers import Drivers
from sim_pybullet.traffic.ducks import Ducks
from sim_pybullet.traffic.lights import Lights, lamps
from sim_pybullet.traffic.scenario import Scenario
from sim_pybullet.traffic.streets import NO_JUNCTION, CarStart, Layout, Streets

NEAR_M = 0.35  # from axle to junction: who is so near asks
STOP_M = 0.17  # where a car stands: the red line and a few centimetres before it
STAND_S = 0.5
_WAITS_MPS = 0.03
STANDS_MPS = 0.02
_EXIT_M = 0.7  # must be free behind the line, so that nobody stands in a junction
_TIGHT_M = 0.35  # is enough for who has been patient, or a queue all round a block never moves
_PATIENCE_S = 6.0  # who has the way and does not go loses it


class Approach(NamedTuple):
    """How A cars of G groups come to junctions; numbers of junctions, or `NO_JUNCTION`."""

    next: np.ndarray  # (G, A) int, the one ahead
    line_m: np.ndarray  # (G, A) to its border, from the axle
    inside: np.ndarray  # (G, A) int, the one it is in
    free_m: np.ndarray  # (G, A)
    red: np.ndarray  # (G, A) bool
    ttc_s: np.ndarray  # (G, A) to a collision with who is on the way now, at these speeds


class RightOfWay:
    """Who may enter the junctions of G groups."""

    def __init__(self, groups: int, cars: int, junctions: int) -> None:
        self._holder = np.full((groups, junctions), -1)
        self._held_s = np.zeros((groups, junctions))
        self._stood_s = np.zeros((groups, cars))

    def begin(self, group: int) -> None:
        """Forget what was."""
        self._holder[group], self._held_s[group], self._stood_s[group] = -1, 0.0, 0.0

    def ask(self, approach: Approach, speeds_mps: np.ndarray) -> np.ndarray:
        """(G, A) bool: who may go on into the next junction, one decision later."""
        at_line = approach.line_m < NEAR_M
        stands = at_line & (speeds_mps < _WAITS_MPS)
        self._stood_s = np.where(at_line, self._stood_s + CONTROL_DT_S * stands, 0.0)
        self._release(approach)
        may = approach.next == NO_JUNCTION
        asking = np.argwhere(at_line)
        for group, car in asking[np.argsort(-self._stood_s[at_line], kind="stable")].tolist():
            may[group, car] = self._grant(group, car, approach)
        return may

    def _release(self, approach: Approach) -> None:
        groups, junctions = np.nonzero(self._holder >= 0)
        holders = self._holder[groups, junctions]
        outside = approach.inside[groups, holders] != junctions
        self._held_s[groups, junctions] += CONTROL_DT_S * outside
        gone = outside & (approach.next[groups, holders] != junctions)
        gone |= self._held_s[groups, junctions] > _PATIENCE_S
        self._holder[groups[gone], junctions[gone]] = -1

    def _grant(self, group: int, car: int, approach: Approach) -> bool:
        junction = approach.next[group, car]
        holder = self._holder[group, junction]
        if holder == car:
            return True
        line_m, free_m = approach.line_m[group, car], approach.free_m[group, car]
        stood_s = self._stood_s[group, car]
        exit_m = _EXIT_M if stood_s < _PATIENCE_S else _TIGHT_M
        ready = stood_s >= STAND_S and free_m > line_m + exit_m
        taken = holder >= 0 or (approach.inside[group] == junction).any()
        if taken or not ready or approach.red[group, car]:
            return False
        self._holder[group, junction], self._held_s[group, junction] = car, 0.0
        return True


DUCK_M, ROBOT_M = 0.10, 0.15  # centres nearer than that have met (the AI Driving Olympics' rules)
_TOUCH = 0.9  # of the distance at which two have met: there their bodies do
_WALKS_S = (0.8, 1.6)  # a walking duck counts where it will be, too
_TRIES = 20  # to find room for all on a small map
_COLOURS = ("blue", "red", "green", "white", "orange", "grey")


class Body(IntEnum):
    """What a road user is."""

    DUCK = 1
    ROBOT = 2
    THING = 3


class Crowd:
    """Road users of G groups of P robots of ours, on the maps of ``streets``.

    Robots of ours are told in every call: ``poses`` (G, P, 3). Places in a group: ours, other cars,
    parked ones, ducks, things.
    """

    def __init__(self, streets: Streets, how: Scenario, groups: int) -> None:
        self._streets, self._how = streets, how
        self.ours, self._parked = len(how.robots_pcs), len(how.robots_parked)
        kinds = [[thing.kind for thing in each] for each in streets.movers]
        cars = len(how.robots_npcs) + max(each.count("duckiebot") for each in kinds)
        ducklings = how.nduckies + max(each.count("duckie") for each in kinds)
        self.drivers = Drivers(groups, cars, streets.tours[0][0])
        self.ducks = Ducks(groups, ducklings)
        self.lights = Lights(groups, max(map(len, streets.lights)))
        self.parked = np.full((groups, self._parked, 3), np.nan)
        self._things = np.full((groups, max(map(len, streets.blocked_m)), 2), np.nan)
        self._way = RightOfWay(groups, self.ours + cars, streets.junctions)
        self._robots = self.ours + cars + self._parked
        counts = (self._robots, ducklings, self._things.shape[1])
        self.kinds = np.repeat((Body.ROBOT, Body.DUCK, Body.THING), counts)  # (B,)
        self.meet_m = np.repeat((ROBOT_M, DUCK_M, 0.0), counts)  # nearer centres have met
        self.maps = np.zeros(groups, dtype=int)
        self.line_m = np.full((groups, self.ours), np.inf)  # to where ours should stand
        self._before = self._after = self._now()

    @property
    def movers(self) -> tuple[Mover, ...]:
        """What cameras must draw, in the order of `shown`."""
        looks = [robot_solids(_COLOURS[k % len(_COLOURS)]) for k in range(self._robots)]
        lights = (lamps(0), lamps(1)) * self.lights.places.shape[1]
        return (*looks, *(duck_solids(),) * self.ducks.poses.shape[1], *lights)

    def begin(
        self,
        group: int,
        k: int,
        rng: np.random.Generator,
        spread: float = 1.0,
        at_m: tuple[float, float] | None = None,
    ) -> list[CarStart]:
        """Draw an episode of one group on map ``k``; where its robots of ours begin.

        ``at_m``: where the only one stands already. ``spread``: as of `sim_pybullet.tasks.spec`.
        """
        for tries_left in reversed(range(_TRIES)):
            layout = Layout(self._streets, k, self._how, rng, at_m)
            try:
                ours = [layout.car(spread) for _ in range(self.ours if at_m is None else 0)]
                self._begin_others(group, k, layout, rng)
                break
            except MapError:  # who came first may have taken all the room
                if not tries_left:
                    raise
        self._begin_standing(group, k, rng)
        return ours

    def _begin_others(self, group: int, k: int, layout: Layout, rng: np.random.Generator) -> None:
        how, movers = self._how, self._streets.movers[k]
        cars = [layout.car() for _ in how.robots_npcs]
        starts = [(car.path, car.arc_m) for car in cars]
        starts += [layout.tour_at(o) for o in movers if o.kind == "duckiebot"]
        self.drivers.begin(group, starts, how, rng)
        for place in range(self._parked):
            self.parked[group, place] = layout.car().pose
        tile_m = self._streets.tile_m[k]
        walkers = [(o.x_m, o.y_m, o.heading_rad, tile_m) for o in movers if o.kind == "duckie"]
        places = np.array([*layout.ducks().reshape(-1, 4), *walkers]).reshape(-1, 4)
        self.ducks.begin(group, places, how, rng)

    def _begin_standing(self, group: int, k: int, rng: np.random.Generator) -> None:
        lights, things = self._streets.lights[k], self._streets.blocked_m[k]
        at = np.array([(o.x_m, o.y_m) for o in lights]).reshape(1, -1, 2)
        self.lights.begin(group, lights, self._streets.junction_at(np.array([k]), at)[0], rng)
        self._things[group] = np.nan
        self._things[group, : len(things)] = things
        self.maps[group] = k
        self._way.begin(group)
        self._before = self._after = self._now()

    def bodies(self, poses: np.ndarray) -> np.ndarray:
        """(G, B, 2) where everybody is, ours at poses (G, P, 3) first; NaN for who is not there."""
        robots = np.concatenate((poses, self.drivers.poses, self.parked), axis=1)[..., :2]
        return np.concatenate((robots, self.ducks.poses[..., :2], self._things), axis=1)

    def look(
        self, poses: np.ndarray, paths: PathBatch, arc_m: np.ndarray, velocities: np.ndarray
    ) -> Approach:
        """What all cars have ahead, ours at ``arc_m`` (G P,) of their paths first: (G, A)."""
        from sim_pybullet.traffic.near import steps_ahead

        mine = np.concatenate((velocities, self.drivers.velocities), axis=1)
        everyone = np.concatenate((poses, self.drivers.poses), axis=1)  # who looks
        groups, cars = everyone.shape[:2]
        own = paths.points_at(arc_m[:, None] + AHEAD_M).reshape(groups, self.ours, -1, 2)
        points = np.concatenate((own, self.drivers.points(AHEAD_M)), axis=1)
        xy_m, theirs, clear_m = self._obstacles(self.bodies(poses), mine)
        seen = np.repeat(xy_m[:, None], cars, axis=1)
        seen[:, np.arange(cars), np.arange(cars)] = np.nan  # nobody is in their own way
        ways, who, them = (a.reshape(-1, *a.shape[2:]) for a in (points, everyone, seen))
        steps = steps_ahead(ways, who, them, np.tile(clear_m, (len(who), 1)))
        free_m = nearest(steps)[0].reshape(groups, cars)
        now = nearest(steps[:, : len(self.kinds)])
        now_m, what = (each.reshape(groups, cars) for each in now)
        whom = np.maximum(what, 0)
        others, there = (np.take_along_axis(each, whom[..., None], 1) for each in (theirs, xy_m))
        apart_m, way = meeting(points, everyone, there, clear_m[whom], now_m)
        closing = np.hypot(mine[..., 0], mine[..., 1]) - (others * way).sum(-1)
        meets = (what != NOTHING) & (closing > STANDS_MPS)
        ttc_s = np.where(meets, apart_m / np.maximum(closing, STANDS_MPS), np.inf)
        return self._approach(everyone, points, free_m, ttc_s)

    def think(self, poses: np.ndarray, velocities: np.ndarray, approach: Approach) -> None:
        """One decision of everybody but ours, by what `look` told."""
        ours_mps = np.hypot(*np.moveaxis(velocities, -1, 0))
        may = self._way.ask(approach, np.concatenate((ours_mps, self.drivers.speeds_mps), axis=1))
        may[:, self.ours :] |= ~self.drivers.obeying
        line_m = np.where(may, np.inf, approach.line_m - STOP_M)
        self.line_m = line_m[:, : self.ours]
        before_m = self.bodies(poses)
        self.drivers.step(approach.free_m[:, self.ours :], line_m[:, self.ours :])
        self.drivers.stand(self._touching(before_m, self.bodies(poses)))
        self.ducks.step(self.bodies(poses)[:, : self._robots])
        self.lights.step()
        self._before, self._after = self._after, self._now()

    def _touching(self, before_m: np.ndarray, now_m: np.ndarray) -> np.ndarray:
        """(G, C) which cars drove against anybody, wherever that one was a decision ago (G, B, 2)
        or is: nobody drives through anybody."""
        cars = np.arange(self.ours, self.ours + self.drivers.poses.shape[1])
        touching = np.zeros(self.drivers.speeds_mps.shape, dtype=bool)
        before_m, now_m = (np.moveaxis(each, -1, 0).copy() for each in (before_m, now_m))
        for there in (before_m, now_m):
            apart, were_apart = (
                np.sqrt(((there[:, :, None] - here[:, :, cars, None]) ** 2).sum(axis=0))
                for here in (now_m, before_m)
            )
            apart[:, np.arange(len(cars)), cars] = np.inf
            touching |= (apart < np.minimum(_TOUCH * self.meet_m, were_apart)).any(axis=-1)
        return touching

    def shown(self, poses: np.ndarray, share: float) -> np.ndarray:
        """(G, P, U, 3) where each of ours sees the movers when a share of the decision is over."""
        between = self._after
        if share < 1.0:
            moved = between - self._before
            moved[..., 2] = wrap_angle(moved[..., 2])
            between = between - (1.0 - share) * np.nan_to_num(moved)
        between = np.concatenate((poses, between), axis=1)
        each = np.repeat(between[:, None], self.ours, axis=1)
        each[:, np.arange(self.ours), np.arange(self.ours)] = np.nan
        return each

    def _now(self) -> np.ndarray:
        """(G, U - P, 3) where all movers are but ours."""
        return np.concatenate(
            (self.drivers.poses, self.parked, self.ducks.poses, self.lights.shown()), axis=1
        )

    def _obstacles(
        self, xy_m: np.ndarray, driving: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Bodies at (G, B, 2), of which the first drive with velocities (G, A, 2), and ducks also
        where they will be: (G, B + 2 D, 2) places and velocities; and how far to stay away,
        (B + 2 D,)."""
        ducklings, walks = self.kinds == Body.DUCK, self.ducks.velocities
        velocities = np.zeros(xy_m.shape)
        velocities[:, : driving.shape[1]], velocities[:, ducklings] = driving, walks
        later = [xy_m[:, ducklings] + after_s * walks for after_s in _WALKS_S]
        near_m = np.full(2 * int(ducklings.sum()), DUCK_M)
        return (
            np.concatenate((xy_m, *later), axis=1),
            np.concatenate((velocities, walks, walks), axis=1),
            np.concatenate((np.maximum(self.meet_m, HALF_ROBOT_M), near_m)),
        )

    def _approach(
        self, poses: np.ndarray, points: np.ndarray, free_m: np.ndarray, ttc_s: np.ndarray
    ) -> Approach:
        inside = self._streets.junction_at(self.maps, poses[..., :2])
        ahead = self._streets.junction_at(self.maps, points)
        other = (ahead != NO_JUNCTION) & (ahead != inside[..., None])
        first = other.argmax(axis=-1)
        found = np.take_along_axis(ahead, first[..., None], axis=-1)[..., 0]
        coming = np.where(other.any(axis=-1) & np.isfinite(poses[..., 0]), found, NO_JUNCTION)
        line_m = np.where(coming == NO_JUNCTION, np.inf, (first + 0.5) * STEP_M)
        red = self.lights.red(coming, poses[..., 2])
        return Approach(coming, line_m, inside, free_m, red, ttc_s)


def duck_solids() -> Mover:
    """A duck, as cameras draw it."""
    return object_solids(MapObject("duck", "duckie", 0.0, 0.0, 0.0, ducks.HEIGHT_M))


def robot_solids(colour: str) -> Mover:
    """Another robot, as cameras draw it."""
    robot = MapObject("robot", "duckiebot", 0.0, 0.0, 0.0, drivers.HEIGHT_M, color=colour)
    return object_solids(robot)
