"""Tours: closed ways through a map that somebody without a destination can drive for ever."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from robot.errors import MapError, PlanError
from robot.navigation.path import Path
from robot.navigation.planner import LaneGraph

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
