"""``Manoeuvres``: every bend and every way over a junction, once each (paper A, section 4.4)."""

from collections.abc import Sequence
from functools import partial

import numpy as np

from robot.errors import ConfigError, MapError
from robot.geometry import wrap_angle
from robot.navigation.path import Path
from robot.navigation.planner import LaneGraph
from robot.navigation.road_map import RoadMap
from sim_pybullet.tasks.navigation import Navigation
from sim_pybullet.tasks.spec import Mission, TaskSpec, register


def manoeuvres(road_map: RoadMap) -> tuple[Path, ...]:
    """The ways through all bends of a map, then over its junctions, each in the order of the lanes.

    A path begins where the lane before the manoeuvre begins and ends where the lane behind it ends;
    of several such lanes the straightest counts. MapError if the map has neither.
    """
    graph = LaneGraph(road_map)
    nodes_rad = graph.node_poses[:, 2]
    turns_rad = [abs(float(wrap_angle(nodes_rad[b] - nodes_rad[a]))) for a, b in graph.lane_nodes]
    found: dict[bool, list[Path]] = {False: [], True: []}  # by whether it is a junction
    for lane, (start, end) in enumerate(graph.lane_nodes):
        tile = graph.lanes[lane].tile
        into = [k for k, (_, after) in enumerate(graph.lane_nodes) if after == start]
        out = [k for k, (before, _) in enumerate(graph.lane_nodes) if before == end]
        if tile.kind != "straight" and into and out:
            straightest = partial(min, key=turns_rad.__getitem__)
            lanes = (straightest(into), lane, straightest(out))
            if not graph.closed.intersection(lanes):
                curves = [graph.lanes[each].control_points_m for each in lanes]
                found[tile.is_junction].append(Path.from_beziers(curves))
    paths = (*found[False], *found[True])
    if not paths:
        raise MapError(f"{road_map.name}: expected bends or junctions, found none; try arena")
    return paths


class Manoeuvres(Navigation):
    """`Navigation` over the manoeuvres of one map, in turn, instead of random missions.

    ConfigError for several maps or none, MapError for one without manoeuvres.
    """

    def __init__(
        self, road_maps: Sequence[RoadMap], n_robots: int, start_spread: float = 1.0
    ) -> None:
        if len(road_maps) != 1:
            raise ConfigError(f"Manoeuvres: expected one map, got {len(road_maps)}")
        super().__init__(road_maps, n_robots, start_spread)
        self.manoeuvres = manoeuvres(road_maps[0])

    def _mission(self, road_map: int, rng: np.random.Generator, turn: int | None) -> Mission:  # noqa: ARG002
        number = int(rng.integers(len(self.manoeuvres))) if turn is None else turn
        return self.manoeuvres[number % len(self.manoeuvres)], 0.0


register(
    TaskSpec(
        name="manoeuvres",
        title="Manoeuvres",
        purpose="Every bend and every way over a junction, once each (paper A, section 4.4).",
        kind=Manoeuvres,
        map="arena",
        learned=False,
    )
)
