"""``Streets``: what road users must know of the maps of a batch."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from robot.errors import MapError
from robot.navigation.map_objects import MapObject, blocked, footprint, objects_of
from robot.navigation.path import Path
from robot.navigation.planner import LaneGraph
from robot.navigation.road_map import RoadMap
from robot.navigation.tiles import STEPS
from sim_pybullet.traffic.tours import tours

MOVING = ("duckie", "duckiebot")  # kinds that move where a map says `static: false`
LIGHT = "trafficlight"  # which changes though it stands
NO_JUNCTION = -1
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
    """Tours, junctions, things that stand and things that move, of M maps.

    Attributes:
        road_maps: the maps without the objects that move.
        tours: of every map.
        places: on the tours of every map.
        movers, lights: objects of every map.
        blocked_m: (K, 2) of every map, where things stand in a lane.
    """

    def __init__(self, road_maps: Sequence[RoadMap]) -> None:
        objects = [objects_of(road_map) for road_map in road_maps]
        self.movers = [tuple(o for o in each if _moves(o)) for each in objects]
        self.lights = [tuple(o for o in each if o.kind == LIGHT) for each in objects]
        self.road_maps = tuple(
            replace(road_map, objects=_still(road_map, each))
            for road_map, each in zip(road_maps, objects, strict=True)
        )
        self.blocked_m = [blocked(road_map).points_m for road_map in road_maps]
        self.tours = [tours(LaneGraph(m), np.random.default_rng(0)) for m in road_maps]
        self.places = [_places(*each) for each in zip(road_maps, self.tours, objects, strict=True)]
        self.tile_m = np.array([road_map.tile_size_m for road_map in road_maps])
        rows = max(road_map.rows for road_map in road_maps)
        columns = max(road_map.columns for road_map in road_maps)
        self._road = np.zeros((len(road_maps), rows, columns), dtype=bool)  # from the south-west
        self._junction = np.full(self._road.shape, NO_JUNCTION)
        for k, road_map in enumerate(road_maps):
            for tile in road_map.road_tiles:
                self._road[k, road_map.rows - 1 - tile.row, tile.column] = True
            for number, junction in enumerate(_junctions(road_map)):
                for row, column in junction:
                    self._junction[k, road_map.rows - 1 - row, column] = number
        self.junctions = int(self._junction.max()) + 1

    def on_road(self, maps: np.ndarray, xy_m: np.ndarray) -> np.ndarray:
        """(N, ...) bool: whether points (N, ..., 2) of maps (N,) lie on a tile of road."""
        return self._read(self._road, maps, xy_m, False)

    def junction_at(self, maps: np.ndarray, xy_m: np.ndarray) -> np.ndarray:
        """(N, ...) number of the junction under points (N, ..., 2), or `NO_JUNCTION`."""
        return self._read(self._junction, maps, xy_m, NO_JUNCTION)

    def _read(
        self, grid: np.ndarray, maps: np.ndarray, xy_m: np.ndarray, beyond: int
    ) -> np.ndarray:
        maps = maps.reshape(-1, *[1] * (xy_m.ndim - 2))
        tile = np.floor(np.nan_to_num(xy_m, nan=-1.0) / self.tile_m[maps][..., None]).astype(int)
        column, row = tile[..., 0], tile[..., 1]
        inside = (tile >= 0).all(axis=-1) & (row < grid.shape[1]) & (column < grid.shape[2])
        found = grid[maps, np.where(inside, row, 0), np.where(inside, column, 0)]
        return np.where(inside, found, beyond)


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
    """The map's objects without those that move, in the form of its file."""
    entries = road_map.objects
    moving = [_moves(thing) for thing in objects]
    if isinstance(entries, list):
        return [entry for entry, moves in zip(entries, moving, strict=True) if not moves]
    pairs = zip((entries or {}).items(), moving, strict=True)
    return {name: entry for (name, entry), moves in pairs if not moves}
