"""What a map puts on a lane closes it, for routes and for starts."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from robot.errors import PlanError
from robot.geometry import Pose
from robot.navigation.map_objects import blocked
from robot.navigation.planner import LaneGraph, plan_route, route_between
from robot.navigation.road_map import ORIENTATIONS, RoadMap, load_map, read_map, shipped_maps

TILE_M = 0.585


def with_barrier(name: str, lane: int) -> tuple[RoadMap, np.ndarray]:
    """A shipped map with a barrier in the middle of a lane, and where that is."""
    bare = load_map(name)
    at = bare.lanes[lane].control_points_m.mean(axis=0)
    return with_thing(bare, at), at


def with_thing(bare: RoadMap, at: np.ndarray) -> RoadMap:
    rows = [[f"{t.kind}/{ORIENTATIONS[t.quarter_turns]}" for t in row] for row in bare.tiles]
    place = [float(at[0] / TILE_M), float(bare.rows - at[1] / TILE_M)]
    thing: dict[str, Any] = {"kind": "barrier", "pos": place, "height": 0.08}
    return read_map({"tile_size": TILE_M, "tiles": rows, "objects": [thing]}, bare.name)


def test_things_beside_the_road_close_no_lane() -> None:
    for name in shipped_maps():
        assert not blocked(load_map(name)).lanes, name


@pytest.mark.parametrize("flags", [{"optional": True}, {"static": False}, {}])
def test_what_is_not_always_there_closes_a_lane_only_if_every_thing_counts(flags: Any) -> None:
    bare = load_map("loop")
    closed = with_thing(bare, bare.lanes[4].control_points_m.mean(axis=0))
    (thing,) = closed.objects
    road_map = replace(closed, objects=[{**thing, **flags}])
    assert (4 in blocked(road_map).lanes) is (not flags)
    assert 4 in blocked(road_map, every=True).lanes


def test_a_route_leads_round_a_barrier_and_a_destination_behind_it_is_refused() -> None:
    bare = load_map("town")
    first, last = (bare.lanes[lane].control_points_m for lane in (0, 60))
    start, goal = Pose(*first[0], float(np.arctan2(*(first[1] - first[0])[::-1]))), last[3]
    free = plan_route(LaneGraph(bare), start, (float(goal[0]), float(goal[1])))
    across = free.lanes[len(free.lanes) // 2]
    closed_map, at = with_barrier("town", across)
    closed = blocked(closed_map)
    assert across in closed.lanes
    graph = LaneGraph(closed_map)
    route = plan_route(graph, start, (float(goal[0]), float(goal[1])))
    assert not closed.lanes.intersection(route.lanes)
    assert route.cost >= free.cost
    with pytest.raises(PlanError, match=rf"got \({at[0]:.2f}, {at[1]:.2f}\) m, where something"):
        plan_route(graph, start, (float(at[0]), float(at[1])))


@pytest.mark.parametrize(
    ("kind", "turns"),
    [
        ("stop", set()),
        ("yield", set()),
        ("4_way_intersect", set()),
        ("no_left_turn", {90.0}),
        ("no_right_turn", {-90.0}),
        ("oneway_right", {90.0}),
        ("oneway_left", {-90.0}),
        ("do_not_enter", {-90.0, 0.0, 90.0}),
    ],
)
@pytest.mark.parametrize("quarters", range(4))
@pytest.mark.parametrize(("aside_m", "before_m"), [(0.33, 0.35), (0.42, 0.33)])
def test_signs_forbid_turns_to_who_faces_them(
    kind: str, turns: set[float], quarters: int, aside_m: float, before_m: float
) -> None:
    """It stands on the right before a crossing, and shows its face to who comes; or farther to the
    right, nearer to a lane of those who do not see its face."""
    comes_rad = 0.5 * np.pi * quarters
    right = np.array((np.sin(comes_rad), -np.cos(comes_rad)))
    ahead = np.array((np.cos(comes_rad), np.sin(comes_rad)))
    x, y = (0.9, 0.9) + aside_m * right - before_m * ahead
    pose = {"p": [float(x), float(y)], "theta_deg": 90.0 * quarters + 180.0}
    sign = {"kind": f"sign_{kind}", "pose": {"~SE2Transform": pose}, "height": 0.18}
    tiles = [["grass", "straight/N", "grass"], ["straight/E", "4way", "straight/W"],
             ["grass", "straight/S", "grass"]]  # fmt: skip
    crossing = read_map({"tile_size": 0.6, "tiles": tiles, "objects": [sign]}, "crossing")
    found = set()
    for lane in blocked(crossing).lanes:
        way = crossing.lanes[lane].control_points_m
        begins, ends = way[1] - way[0], way[3] - way[2]
        np.testing.assert_allclose(begins / np.hypot(*begins), ahead, atol=1e-9)
        turned = np.arctan2(begins[0] * ends[1] - begins[1] * ends[0], begins @ ends)
        found.add(round(float(np.degrees(turned)), 6) + 0.0)
    assert found == turns
    assert LaneGraph(crossing).closed == blocked(crossing).lanes


@pytest.mark.parametrize(("away_m", "forbids"), [(0.55, True), (0.65, False)])
def test_a_sign_more_than_a_tile_from_a_way_forbids_nothing(away_m: float, forbids: bool) -> None:
    """To the west of where the lane to the east begins, whose face it shows to it."""
    tiles = [["grass"] * 3, ["grass", "straight/E", "grass"], ["grass"] * 3]
    pose = {"p": [0.6 - away_m, 0.9 - 0.12], "theta_deg": 180.0}
    sign = {"kind": "sign_do_not_enter", "pose": {"~SE2Transform": pose}, "height": 0.18}
    road_map = read_map({"tile_size": 0.6, "tiles": tiles, "objects": [sign]}, "far")
    assert bool(blocked(road_map).lanes) is forbids


def test_where_there_is_no_way_the_place_is_told() -> None:
    ring, at = with_barrier("loop", 4)
    graph = LaneGraph(ring)
    begin, end = graph.lane_nodes[4]
    before = next(k for k, nodes in enumerate(graph.lane_nodes) if nodes[1] == begin)
    behind = next(k for k, nodes in enumerate(graph.lane_nodes) if nodes[0] == end)
    with pytest.raises(PlanError, match=rf"closed at \({at[0]:.2f}, {at[1]:.2f}\) m"):
        route_between(graph, before, 0.5, behind, 0.5)
    assert route_between(graph, behind, 0.5, before, 0.5).cost > 5.0
