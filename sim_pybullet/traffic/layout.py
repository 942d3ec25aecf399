"""Where road users begin an episode, apart from one another and from what stands there."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from robot.errors import MapError
from robot.geometry import Pose
from robot.navigation.path import Path
from robot.navigation.road_map import RoadMap
from sim_pybullet.scenery.footprints import footprint
from sim_pybullet.scenery.map_objects import MapObject
from sim_pybullet.traffic.scenario import Scenario
from sim_pybullet.traffic.streets import Streets

CLEAR_M = 0.15  # from what stands there to where somebody begins
_TRIES = 400
_EDGE_TILES = 0.3  # from the middle of a lane to the edge of its tile


class CarStart(NamedTuple):
    """Beside a point of a tour."""

    path: Path
    arc_m: float
    offset_m: float
    turned_rad: float

    @property
    def pose(self) -> Pose:
        """In the world."""
        x_m, y_m, heading = self.path.pose_at(self.arc_m)
        left_m = self.offset_m
        x_m, y_m = x_m - left_m * math.sin(heading), y_m + left_m * math.cos(heading)
        return Pose(x_m, y_m, heading + self.turned_rad)


class Layout:
    """Draws the places of one episode on map ``k``."""

    def __init__(self, streets: Streets, k: int, how: Scenario, rng: np.random.Generator) -> None:
        self._streets, self._k, self._how, self._rng = streets, k, how, rng
        self._map = streets.road_maps[k]
        things = [footprint(thing) for thing in streets.standing[k]]
        moving = [(thing.x_m, thing.y_m) for thing in streets.movers[k]]
        self._things = np.concatenate((np.array(moving).reshape(-1, 2), *things))
        self.cars: list[tuple[float, float]] = []  # where they are
        self._ducks: list[tuple[float, float]] = []

    def car(self, spread: float = 0.0) -> CarStart:
        """A place for one more car; ``spread`` multiplies what the scenario tolerates."""
        how, rng = self._how, self._rng
        for _ in range(_TRIES):
            path, arc_m = self._place()
            off = rng.uniform(-1.0, 1.0, 2) * spread
            start = CarStart(path, arc_m, how.delta_y_m * off[0],
                             math.radians(how.theta_tol_deg) * off[1])  # fmt: skip
            x_m, y_m, _ = start.pose
            right_tile = _is_straight(self._map, x_m, y_m) or not how.only_straight
            if right_tile and self._free(x_m, y_m) and _apart(self.cars, x_m, y_m, how.min_dist):
                self.cars.append((x_m, y_m))
                return start
        raise self._no_room("robots", how.min_dist)

    def ducks(self) -> np.ndarray:
        """(D, 4) x [m], y [m], heading [rad], how far they walk [m]."""
        return np.array([self._duck(k < self._how.walking) for k in range(self._how.nduckies)])

    def _duck(self, walks: bool) -> tuple[float, float, float, float]:
        how, rng, tile_m = self._how, self._rng, self._map.tile_size_m
        for _ in range(_TRIES):
            path, arc_m = self._place()
            left_m = -_EDGE_TILES * tile_m if walks else rng.uniform(*how.duckie_y_bounds)
            x_m, y_m, along = CarStart(path, arc_m, left_m, 0.0).pose
            if walks and not _is_straight(self._map, *path.pose_at(arc_m)[:2]):
                continue
            if (
                self._free(x_m, y_m)
                and _apart(self._ducks, x_m, y_m, how.duckie_min_dist_from_other_duckie)
                and _apart(self.cars, x_m, y_m, how.duckie_min_dist_from_robot)
            ):
                self._ducks.append((x_m, y_m))
                heading = along + (0.5 * math.pi if walks else rng.uniform(-math.pi, math.pi))
                return x_m, y_m, heading, tile_m if walks else 0.0
        raise self._no_room("ducks", how.duckie_min_dist_from_other_duckie)

    def tour_at(self, thing: MapObject) -> tuple[Path, float]:
        """The tour, and the way along it [m], that a car of the map is nearest to."""
        best: tuple[float, Path, float] | None = None
        for path in self._streets.tours[self._k]:
            at = path.project(thing.x_m, thing.y_m)
            turned = 1.0 - math.cos(at.heading_rad - thing.heading_rad)
            cost = abs(at.offset_m) + 0.1 * turned
            if best is None or cost < best[0]:
                best = cost, path, at.arc_m
        assert best is not None
        return best[1:]

    def _place(self) -> tuple[Path, float]:
        found = self._streets.tours[self._k]
        path = found[int(self._rng.integers(len(found)))]
        return path, float(self._rng.uniform(0.0, path.length_m))

    def _free(self, x_m: float, y_m: float) -> bool:
        return bool((np.hypot(*(self._things - (x_m, y_m)).T) > CLEAR_M).all())

    def _no_room(self, who: str, apart_m: float) -> MapError:
        return MapError(
            f"{self._map.name}: expected room for the {who} of the scenario {apart_m:g} m apart, "
            "found none; ask for fewer, nearer to each other, or take a map with more road"
        )


def _apart(places: list[tuple[float, float]], x_m: float, y_m: float, away_m: float) -> bool:
    return all(math.hypot(x_m - x, y_m - y) > away_m for x, y in places)


def _is_straight(road_map: RoadMap, x_m: float, y_m: float) -> bool:
    tile = road_map.tile_at(x_m, y_m)
    return tile is not None and tile.kind == "straight"
