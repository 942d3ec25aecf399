"""Where road users may drive and begin: the tours, junctions and places of a batch's maps."""

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from robot.errors import MapError, PlanError
from robot.geometry import Pose
from robot.navigation.map_objects import MapObject, blocked, footprint, objects_of
from robot.navigation.path import Path
from robot.navigation.planner import LaneGraph
from robot.navigation.road_map import STEPS, RoadMap
from sim_pybullet.traffic.scenario import Scenario

TOURS = 16  # of a map
_LANES = 16  # of a tour, before it turns back
_TRIES = 40


def tours(graph: LaneGraph, rng: np.random.Generator) -> tuple[Path, ...]:
    """Random tours; on a ring of road, its two lanes. MapError where no way leads back."""
    found: dict[tuple[int, ...], Path] = {}
    for _ in range(_TRIES):
        lanes = _tour(graph, rng)
        if lanes and len(found) < TOURS:
            first = lanes.index(min(lanes))
            key = (*lanes[first:], *lanes[:first])
            if key not in found:
                curves = [graph.lanes[lane].control_points_m for lane in key]
                found[key] = Path.from_beziers(curves, closed=True)
    if not found:
        raise MapError(
            f"{graph.road_map.name}: expected lanes on which one can drive for ever, but every "
            "one leads off the road; use a map such as the shipped maps loop or town"
        )
    return tuple(found.values())


def _tour(graph: LaneGraph, rng: np.random.Generator) -> Sequence[int]:
    """Lanes that lead from a node back to it; none where the walk came to an end of the road."""
    start = node = int(rng.integers(graph.nodes))
    lanes: list[int] = []
    branched = False
    while len(lanes) < _LANES or not branched:
        if not graph.edges[node]:
            return ()
        branched |= len(graph.edges[node]) > 1
        node, lane = graph.edges[node][int(rng.integers(len(graph.edges[node])))]
        lanes.append(lane)
        if node == start and not branched:
            return lanes
        if len(lanes) > len(graph.lanes):
            return ()
    try:
        return [*lanes, *graph.plan(node, start)]
    except PlanError:
        return ()


MOVING = ("duckie", "duckiebot")  # kinds that move where a map says `static: false`
LIGHT = "trafficlight"  # which changes though it stands
NO_JUNCTION, _NO_ROAD = -1, -2
_CLEAR_M = 0.15  # from what stands there to where somebody begins


class Places(NamedTuple):
    """Where on the tours of a map somebody may begin: K points."""

    tour: np.ndarray  # (K,) int
    arc_m: np.ndarray  # (K,) along it
    xy_m: np.ndarray  # (K, 2)
    heading_rad: np.ndarray  # (K,)
    straight: np.ndarray  # (K,) bool, on a straight tile
    free: np.ndarray  # (K,) bool, of things, and of places where something begins to move


class Streets:
    """Tours, junctions, things that stand and things that move, each a list over M maps."""

    def __init__(self, road_maps: Sequence[RoadMap]) -> None:
        objects = [objects_of(road_map) for road_map in road_maps]
        self.movers = [tuple(o for o in each if _moves(o)) for each in objects]
        self.lights = [tuple(o for o in each if o.kind == LIGHT) for each in objects]
        self.road_maps = tuple(  # without the objects that move
            replace(road_map, objects=_still(road_map, each))
            for road_map, each in zip(road_maps, objects, strict=True)
        )
        # where things stand in a lane, (K, 2)
        self.blocked_m = [blocked(road_map).points_m for road_map in road_maps]
        self.tours = [tours(LaneGraph(m), np.random.default_rng(0)) for m in road_maps]
        self.places = [_places(*each) for each in zip(road_maps, self.tours, objects, strict=True)]
        self.tile_m = np.array([road_map.tile_size_m for road_map in road_maps])
        rows = max(road_map.rows for road_map in road_maps)
        columns = max(road_map.columns for road_map in road_maps)
        # Of each tile, from the south-west: its junction, `NO_JUNCTION` or, as around, `_NO_ROAD`.
        self._tiles = np.full((len(road_maps), rows + 1, columns + 1), _NO_ROAD)
        for k, road_map in enumerate(road_maps):
            for tile in road_map.road_tiles:
                self._tiles[k, road_map.rows - 1 - tile.row, tile.column] = NO_JUNCTION
            for number, junction in enumerate(_junctions(road_map)):
                for row, column in junction:
                    self._tiles[k, road_map.rows - 1 - row, column] = number
        self.junctions = max(int(self._tiles.max()), NO_JUNCTION) + 1

    def on_road(self, maps: np.ndarray, xy_m: np.ndarray) -> np.ndarray:
        """(N, ...) bool: whether points (N, ..., 2) of maps (N,) lie on a tile of road."""
        return self._under(maps, xy_m) != _NO_ROAD

    def junction_at(self, maps: np.ndarray, xy_m: np.ndarray) -> np.ndarray:
        """(N, ...) number of the junction under points (N, ..., 2), or `NO_JUNCTION`."""
        return np.maximum(self._under(maps, xy_m), NO_JUNCTION)

    def _under(self, maps: np.ndarray, xy_m: np.ndarray) -> np.ndarray:
        maps = maps.reshape(-1, *[1] * (xy_m.ndim - 2))
        most = np.array(self._tiles.shape[:0:-1]) - 1.0  # there, and at -1, is no road
        tile = np.fmin(np.fmax(xy_m / self.tile_m[maps][..., None], -1.0), most)
        column, row = np.moveaxis(np.floor(tile).astype(int), -1, 0)
        return np.asarray(self._tiles[maps, row, column])


def _places(road_map: RoadMap, found: Sequence[Path], objects: Sequence[MapObject]) -> Places:
    xy_m = np.concatenate([path.points_m for path in found])
    tiles = [road_map.tile_at(x, y) for x, y in xy_m.tolist()]
    things = [np.array([(o.x_m, o.y_m)]) if _moves(o) else footprint(o) for o in objects]
    away = xy_m[:, None] - np.concatenate((np.zeros((0, 2)), *things))
    return Places(
        np.repeat(np.arange(len(found)), [len(path.arc_m) for path in found]),
        np.concatenate([path.arc_m for path in found]),
        xy_m,
        np.concatenate([path.headings_rad for path in found]),
        np.array([tile is not None and tile.kind == "straight" for tile in tiles]),
        (np.hypot(away[..., 0], away[..., 1]) > _CLEAR_M).all(axis=1),
    )


def _junctions(road_map: RoadMap) -> list[set[tuple[int, int]]]:
    """The tiles of each, (row, column); those side by side are one, as nobody may stand between."""
    found: list[set[tuple[int, int]]] = []
    for tile in road_map.road_tiles:
        if tile.is_junction:
            around = {(tile.row + d, tile.column + e) for d, e in STEPS.values()}
            beside = [each for each in found if each & around]
            found = [each for each in found if each not in beside]
            found.append({(tile.row, tile.column)}.union(*beside))
    return found


def _moves(thing: MapObject) -> bool:
    if not thing.static and thing.kind not in MOVING:
        raise MapError(
            f"object {thing.name}: expected static: false of {' or '.join(MOVING)}, "
            f"got it of {thing.kind}"
        )
    return not thing.static


def _still(road_map: RoadMap, objects: Sequence[MapObject]) -> Any:
    """What the map's file says of its objects without those that move, by name."""
    entries = road_map.objects or {}
    told = zip(objects, entries.values() if isinstance(entries, dict) else entries, strict=True)
    return {thing.name: entry for thing, entry in told if not _moves(thing)}


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
        place = self.path.pose_at(self.arc_m)
        x_m, y_m = place.to_world(np.array((0.0, self.offset_m))).tolist()
        return Pose(x_m, y_m, place.heading_rad + self.turned_rad)


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

    def _apart(self, xy_m: np.ndarray, them: list[tuple[float, float]], far_m: float) -> np.ndarray:
        """(K,) bool: which places (K, 2) are far enough from all of them."""
        delta = xy_m[:, None] - np.array(them).reshape(-1, 2)
        return np.asarray((np.hypot(delta[..., 0], delta[..., 1]) > far_m).all(axis=1))
