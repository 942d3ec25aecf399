"""Where road users begin an episode, apart from one another and from what stands there."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from robot.errors import MapError
from robot.geometry import Pose
from robot.navigation.map_objects import MapObject
from robot.navigation.path import Path
from sim_pybullet.traffic.scenario import Scenario
from sim_pybullet.traffic.streets import Streets

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
    """Draws the places of one episode on map ``k``.

    MapError where there is no room, or, at a place that is given, none for the others.
    """

    def __init__(
        self,
        streets: Streets,
        k: int,
        how: Scenario,
        rng: np.random.Generator,
        taken_m: tuple[float, float] | None = None,
    ) -> None:
        self._streets, self._k, self._how, self._rng = streets, k, how, rng
        self._places = streets.places[k]
        self._cars = [] if taken_m is None else [taken_m]
        self._ducks: list[tuple[float, float]] = []

    def car(self, spread: float = 0.0) -> CarStart:
        """A place for one more car; ``spread`` multiplies what the scenario tolerates."""
        how, places = self._how, self._places
        fit = places.free & (places.straight | (not how.only_straight))
        path, arc_m = self._draw(fit & self._apart(places.xy_m, self._cars, how.min_dist), "robots")
        off = self._rng.uniform(-1.0, 1.0, 2) * spread
        askew = math.radians(how.theta_tol_deg) * off[1]
        start = CarStart(path, arc_m, how.delta_y_m * off[0], askew)
        self._cars.append(start.pose[:2])
        return start

    def ducks(self) -> np.ndarray:
        """(D, 4) x [m], y [m], heading [rad], how far they walk [m]."""
        return np.array([self._duck(k < self._how.walking) for k in range(self._how.nduckies)])

    def _duck(self, walks: bool) -> tuple[float, float, float, float]:
        how, rng, places = self._how, self._rng, self._places
        tile_m = self._streets.tile_m[self._k]
        left_m = -_EDGE_TILES * tile_m if walks else rng.uniform(*how.duckie_y_bounds)
        aside = np.stack((-np.sin(places.heading_rad), np.cos(places.heading_rad)), axis=1)
        xy_m = places.xy_m + left_m * aside
        fit = places.free & places.straight  # in a junction it would stand in somebody's way
        fit &= self._apart(xy_m, self._ducks, how.duckie_min_dist_from_other_duckie)
        fit &= self._apart(xy_m, self._cars, how.duckie_min_dist_from_robot)
        path, arc_m = self._draw(fit, "ducks")
        x_m, y_m, along = CarStart(path, arc_m, left_m, 0.0).pose
        self._ducks.append((x_m, y_m))
        heading = along + (0.5 * math.pi if walks else rng.uniform(-math.pi, math.pi))
        return x_m, y_m, heading, tile_m if walks else 0.0

    def tour_at(self, thing: MapObject) -> tuple[Path, float]:
        """The tour, and the way along it [m], that a car of the map is nearest to."""
        places = self._places
        away = np.hypot(*(places.xy_m - (thing.x_m, thing.y_m)).T)
        turned = 1.0 - np.cos(places.heading_rad - thing.heading_rad)
        return self._at(int((away + 0.1 * turned).argmin()))

    def _draw(self, fit: np.ndarray, who: str) -> tuple[Path, float]:
        choices = np.flatnonzero(fit)
        if not len(choices):
            raise MapError(
                f"{self._streets.road_maps[self._k].name}: expected room for the {who} of the "
                "scenario, found none; ask for fewer, nearer to each other, or take a map with "
                "more road"
            )
        return self._at(int(choices[self._rng.integers(len(choices))]))

    def _at(self, place: int) -> tuple[Path, float]:
        tour = self._streets.tours[self._k][self._places.tour[place]]
        return tour, float(self._places.arc_m[place])

    def _apart(
        self, xy_m: np.ndarray, others: list[tuple[float, float]], away_m: float
    ) -> np.ndarray:
        """(K,) bool: which places (K, 2) are far enough from all others."""
        delta = xy_m[:, None] - np.array(others).reshape(-1, 2)
        return np.asarray((np.hypot(delta[..., 0], delta[..., 1]) > away_m).all(axis=1))
