"""Routes: as cheap as Dijkstra's, without U-turns, continuous, and refused with a reason."""

from __future__ import annotations

import heapq
import itertools
import math
from pathlib import Path as FilePath
from typing import Iterator, Tuple

import numpy as np
import pytest

from robot.errors import MapError, PlanError
from robot.geometry import Pose, bezier_points, bezier_tangents, wrap_angle
from robot.navigation.planner import LaneGraph, path_on, plan_path, plan_route
from robot.navigation.road_map import RoadMap, load_map, read_map, shipped_maps
from tests.thorough import count

SIDES = {(1, 0): "E", (-1, 0): "W", (0, 1): "N", (0, -1): "S"}


@pytest.fixture(scope="session")
def all_maps(data_dir: FilePath) -> list[RoadMap]:
    files = sorted((data_dir / "maps").rglob("*.yaml"))
    maps = [load_map(source) for source in [*files, *shipped_maps()]]
    return [road_map for road_map in maps if road_map.lanes]


def dijkstra(graph: LaneGraph, start: int) -> dict[int, float]:
    reached: dict[int, float] = {}
    frontier = [(0.0, start)]
    while frontier:
        spent, node = heapq.heappop(frontier)
        if node in reached:
            continue
        reached[node] = spent
        for after, _ in graph.edges[node]:
            heapq.heappush(frontier, (spent + 1.0, after))
    return reached


def check_against_dijkstra(graph: LaneGraph) -> None:
    for start in range(0, graph.nodes, count(5, 1)):
        cheapest = dijkstra(graph, start)
        for goal in range(graph.nodes):
            if goal in cheapest:
                assert len(graph.plan(start, goal)) == cheapest[goal]
            else:
                with pytest.raises(PlanError, match="without a U-turn"):
                    graph.plan(start, goal)


@pytest.mark.parametrize("name", ["loop", "arena", "town"])
def test_a_star_is_as_cheap_as_dijkstra_on_shipped_maps(name: str) -> None:
    check_against_dijkstra(LaneGraph(load_map(name)))


@pytest.mark.slow
def test_a_star_is_as_cheap_as_dijkstra_on_every_map(all_maps: list[RoadMap]) -> None:
    for road_map in all_maps:
        check_against_dijkstra(LaneGraph(road_map))


def test_plans_are_chains_of_lanes(all_maps: list[RoadMap]) -> None:
    rng = np.random.default_rng(0)
    for road_map in all_maps:
        graph = LaneGraph(road_map)
        for start, goal in rng.integers(0, graph.nodes, (40, 2)).tolist():
            try:
                plan = graph.plan(start, goal)
            except PlanError:
                continue
            node = start
            for lane in plan:
                assert graph.lane_nodes[lane][0] == node
                node = graph.lane_nodes[lane][1]
            assert node == goal


def test_no_lane_turns_back_and_lanes_meet_in_the_same_direction(all_maps: list[RoadMap]) -> None:
    for road_map in all_maps:
        graph = LaneGraph(road_map)
        for lane, (start, end) in zip(graph.lanes, graph.lane_nodes):
            tangents = bezier_tangents(lane.control_points_m, np.array([0.0, 1.0]))
            headings = np.arctan2(tangents[:, 1], tangents[:, 0])
            turn = wrap_angle(headings[1] - headings[0])
            assert abs(turn) < math.radians(100), "a U-turn"
            for node, heading in zip((start, end), headings):
                gap = wrap_angle(heading - graph.node_poses[node, 2])
                assert abs(gap) < math.radians(1), "lanes meet at an angle"


def test_an_arena_node_never_leads_to_its_opposite_within_one_tile() -> None:
    graph = LaneGraph(load_map("arena"))
    for start in range(graph.nodes):
        for end, _ in graph.edges[start]:
            x, y, heading = graph.node_poses[start]
            back = abs(abs(wrap_angle(graph.node_poses[end, 2] - heading)) - math.pi) < 0.1
            near = np.hypot(*(graph.node_poses[end, :2] - (x, y))) < 0.44
            assert not (back and near)


def tasks(graph: LaneGraph, count: int, seed: int) -> Iterator[tuple[Pose, tuple[float, float]]]:
    rng = np.random.default_rng(seed)
    for _ in range(count):
        t = rng.uniform(0.0, 1.0, 2)
        one, other = rng.integers(0, len(graph.lanes), 2)
        control = graph.lanes[one].control_points_m
        x, y = bezier_points(control, t[:1])[0]
        tangent = bezier_tangents(control, t[:1])[0]
        goal = bezier_points(graph.lanes[other].control_points_m, t[1:])[0]
        yield Pose(x, y, math.atan2(tangent[1], tangent[0])), (goal[0], goal[1])


@pytest.mark.slow
def test_paths_are_continuous_and_lead_from_start_to_goal(all_maps: list[RoadMap]) -> None:
    planned = 0
    for road_map in all_maps:
        graph = LaneGraph(road_map)
        for start, goal in tasks(graph, 12, seed=1):
            try:
                route = plan_route(graph, start, goal)
            except PlanError:
                continue
            planned += 1
            for one, other in zip(route.curves_m, route.curves_m[1:]):
                assert np.hypot(*(other[0] - one[3])) < 1e-6
                out, into = one[3] - one[2], other[1] - other[0]
                angle = math.atan2(out[0] * into[1] - out[1] * into[0], out @ into)
                assert abs(angle) < math.radians(2)
            path = plan_path(graph, start, goal)
            assert np.hypot(*(path.points_m[0] - start[:2])) < 0.011
            assert np.hypot(*(path.points_m[-1] - goal)) < 0.011
            assert np.hypot(*np.diff(path.points_m, axis=0).T).max() <= 0.02002
    assert planned > 200


def test_a_route_costs_the_lanes_that_it_drives() -> None:
    graph = LaneGraph(load_map("town"))
    for start, goal in tasks(graph, 100, seed=2):
        route = plan_route(graph, start, goal)
        assert len(route.lanes) - 2.0 <= route.cost <= len(route.lanes)


def test_a_goal_ahead_on_the_lane_is_driven_to_and_one_behind_is_driven_round_to() -> None:
    arena = load_map("arena")
    right_lane_m = 4.5 * 0.44 + 0.2 * 0.44  # column 4, northbound
    start = Pose(right_lane_m, 0.6, math.pi / 2)
    assert plan_path(arena, start, (right_lane_m, 0.8)).length_m == pytest.approx(0.2, abs=1e-3)
    assert plan_path(arena, start, (right_lane_m, 0.5)).length_m > 2.0
    assert plan_path(arena, start, (right_lane_m, 0.6)).length_m < 0.01


def test_the_start_takes_the_lane_along_its_heading() -> None:
    arena = load_map("arena")
    north = plan_path(arena, Pose(1.98, 0.6, math.pi / 2), (1.0, 2.55))
    south = plan_path(arena, Pose(1.98, 0.6, -math.pi / 2), (1.0, 2.55))
    assert north.headings_rad[0] == pytest.approx(math.pi / 2)
    assert south.headings_rad[0] == pytest.approx(-math.pi / 2)


def test_a_robot_that_has_begun_to_turn_goes_on_as_it_is_turned() -> None:
    """Where the lanes of a junction part, the nearer one is not always the one it drives on."""
    graph = LaneGraph(load_map("arena"))
    begun = Pose(1.011, 0.384, -1.407)  # to the left; 8 mm nearer to the lane to the right
    right = (0.6, 0.31)
    path = plan_path(graph, begun, right)
    assert path.headings_rad[8] > begun.heading_rad, "on to the left, and round"
    turning_right = begun._replace(heading_rad=-1.68)
    assert plan_path(graph, turning_right, right).length_m < 0.5


def test_unless_no_way_leads_on() -> None:
    """Every arm of this junction is a dead end."""
    arms = [["grass", "straight/N", "grass"], ["straight/E", "4way", "straight/E"]]
    arms.append(["grass", "straight/N", "grass"])
    graph = LaneGraph(read_map({"tiles": arms, "tile_size": 0.44}, "cross"))
    parted = 0
    for one, other in itertools.permutations(range(len(graph.lanes)), 2):
        if graph.lane_nodes[one][0] != graph.lane_nodes[other][0]:
            continue
        control = graph.lanes[one].control_points_m
        t = np.array([0.12])
        (place,), (ahead,) = bezier_points(control, t), bezier_tangents(control, t)
        start = Pose(*place, math.atan2(ahead[1], ahead[0]))
        x_m, y_m = bezier_points(graph.lanes[other].control_points_m, np.array([0.9]))[0]
        if graph.road_map.lane_index.near(*place).distance_m[other] < 0.01:
            parted += 1
            assert plan_route(graph, start, (x_m, y_m)).lanes == (other,)
    assert parted


def test_what_cannot_be_planned_says_why() -> None:
    arena = load_map("arena")
    on_road = Pose(2.07, 0.6, 0.0)
    with pytest.raises(PlanError, match=r"start on the road, got \(0\.70, 0\.70\).*nearest lane"):
        plan_path(arena, Pose(0.7, 0.7, 0.0), (2.0, 0.6))
    with pytest.raises(PlanError, match="goal on the road"):
        plan_path(arena, on_road, (5.0, 5.0))
    dead_end = read_map({"tiles": [["straight/E"] * 3], "tile_size": 0.5}, "dead end")
    with pytest.raises(PlanError, match="without a U-turn"):
        plan_path(dead_end, Pose(1.2, 0.15, 0.0), (0.2, 0.35))
    with pytest.raises(MapError, match="map with road"):
        LaneGraph(read_map({"tiles": [["grass"]], "tile_size": 0.5}, "meadow"))


@pytest.mark.parametrize("name", ["loop", "arena", "town"])
def test_the_way_on_is_long_enough_and_turns_left_only_where_it_must(name: str) -> None:
    graph = LaneGraph(load_map(name))
    for lane in graph.lanes:
        (at,) = bezier_points(lane.control_points_m, np.array([0.3]))
        (along,) = bezier_tangents(lane.control_points_m, np.array([0.3]))
        start = Pose(float(at[0]), float(at[1]), math.atan2(along[1], along[0]))
        way = path_on(graph, start, 1.5)
        assert way.length_m >= 1.5
        begin = way.project(start.x_m, start.y_m)
        assert abs(begin.offset_m) < 0.01
        assert np.hypot(*np.diff(way.points_m, axis=0).T).max() < 0.03, "it is one line"
        assert all(graph.road_map.on_road(x, y) for x, y in way.points_m.tolist())


@pytest.mark.parametrize(("toward_rad", "wanted"), [(-0.1, (0, -1)), (-0.5 * math.pi, (-1, 0))])
def test_the_way_on_over_a_junction_is_as_wanted_or_else_the_other(
    toward_rad: float, wanted: Tuple[int, int]
) -> None:
    """Straight on (0) or to the right (-1), where both are there."""
    arena = load_map("arena")
    graph = LaneGraph(arena)
    seen = set()
    for number, lane in enumerate(graph.lanes):
        ways = [way for _, way in graph.edges[graph.lane_nodes[number][1]]]
        if len(ways) < 2:
            continue
        (along,) = bezier_tangents(lane.control_points_m, np.array([1.0]))
        end = Pose(*lane.control_points_m[3], math.atan2(along[1], along[0])).moved(-0.02, 0.0)
        way = path_on(graph, end, arena.tile_size_m, toward_rad)
        leave = [way.headings_rad[-1], *(graph.node_poses[graph.lane_nodes[e][1], 2] for e in ways)]
        turns = np.round(np.asarray(wrap_angle(np.array(leave) - end.heading_rad)) * 2.0 / math.pi)
        open_ways = set(turns[1:].tolist())
        assert turns[0] == next(turn for turn in wanted if turn in open_ways)
        seen.add(turns[0])
    assert seen == {0, -1}


def test_off_the_road_there_is_no_way_on() -> None:
    with pytest.raises(PlanError, match="start"):
        path_on(LaneGraph(load_map("town")), Pose(-3.0, 0.0, 0.0), 1.0)


@pytest.mark.parametrize(("east", "north", "heading_deg"), [(-0.75, -0.2, 0.0), (0.2, -0.75, 90.0)])
def test_where_two_lanes_cross_a_destination_is_on_the_one_that_is_nearer_to_drive(
    east: float, north: float, heading_deg: float
) -> None:
    """Straight on into the crossing, from the west or from the south; in tiles from its middle."""
    town = load_map("town")
    cross = next(tile for tile in town.road_tiles if tile.kind == "4way")
    middle = np.array((cross.column + 0.5, town.rows - cross.row - 0.5))
    begin, goal = ((middle + at) * town.tile_size_m for at in ((east, north), (0.2, -0.2)))
    start = Pose(float(begin[0]), float(begin[1]), math.radians(heading_deg))
    assert plan_route(LaneGraph(town), start, (float(goal[0]), float(goal[1]))).cost < 1.2
