"""Figures of navigation to the digit: constants as literals, and pictures by their sums."""

from __future__ import annotations

import math

import numpy as np
import pytest

from robot.errors import PlanError
from robot.geometry import Pose, bezier_points, bezier_tangents
from robot.navigation import navigator
from robot.navigation.path import (
    FIRST_POINT_M,
    POINT_SPACING_M,
    Path,
    PathBatch,
    lane_loop,
    path_input,
)
from robot.navigation.planner import LaneGraph, plan_route, route_between
from robot.navigation.road_map import LaneIndex, load_map
from robot.navigation.road_paint import road_paint

STRAIGHT = np.array([[0.0, 0.0], [1.0, 0.0], [2.0, 0.0], [3.0, 0.0]])


def test_when_a_mission_is_given_up() -> None:
    assert (navigator.ARRIVAL_M, navigator.OFF_PATH_TILES) == (0.05, 0.25)
    assert math.degrees(navigator.MAX_HEADING_ERROR_RAD) == pytest.approx(100.0)
    assert (navigator.IN_LANE_TILES, navigator.DETOURS, navigator.JUMPS) == (0.1, 3, 5)
    assert math.degrees(navigator.IN_LANE_RAD) == pytest.approx(30.0)
    assert (navigator.MAP_MARGIN_M, navigator.USUAL_DELAY_S, navigator.BOUND_S) == (0.3, 0.25, 1.0)


def test_the_ten_points_begin_six_centimetres_ahead_and_are_four_apart() -> None:
    assert (FIRST_POINT_M, POINT_SPACING_M) == (0.06, 0.04)
    seen = path_input(Path.from_beziers([STRAIGHT]), Pose(1.0, 0.03, 0.1))
    expected = [math.atan2(-0.03, 0.06 + 0.04 * k) - 0.1 for k in range(10)]
    np.testing.assert_allclose(seen, np.clip(np.array(expected) / (math.pi / 4), -1, 1), atol=1e-6)


PAINT = {  # shape, and of white, yellow and known: mean, and its moments by row and by column
    "arena": ((364, 320, 3), (0.12222, 0.029622, 0.347115), (22.156769, 5.396751, 63.022596),
              (19.49551, 4.72506, 55.3649)),
    "loop": ((334, 451, 3), (0.089873, 0.025168, 0.363504), (14.966883, 4.195357, 60.614224),
             (20.22182, 5.66374, 81.87918)),
}  # fmt: skip


@pytest.mark.parametrize("name", PAINT)
def test_the_paint_of_a_map(name: str) -> None:
    cover = road_paint(load_map(name)).cover
    shape, mean, by_row, by_column = PAINT[name]
    assert cover.shape == shape
    assert cover.mean((0, 1)) == pytest.approx(mean, rel=1e-4)
    rows, columns = np.arange(shape[0])[:, None, None], np.arange(shape[1])[None, :, None]
    assert (cover * rows).mean((0, 1)) == pytest.approx(by_row, rel=1e-4)
    assert (cover * columns).mean((0, 1)) == pytest.approx(by_column, rel=1e-4)


@pytest.mark.parametrize(("gap_m", "joined"), [(0.019, True), (0.021, False)])
@pytest.mark.parametrize("closed", [False, True])
def test_a_path_joins_gaps_up_to_two_centimetres(gap_m: float, joined: bool, closed: bool) -> None:
    curves = [STRAIGHT, STRAIGHT + np.array((3.0 + gap_m, 0.0))]
    if closed:
        curves = [STRAIGHT, np.linspace((3.0, 0.0), (gap_m, 0.0), 4)]
    if joined:
        Path.from_beziers(curves, closed=closed)
    else:
        with pytest.raises(PlanError, match=f"gap of {gap_m:.3f} m after number {int(closed)}"):
            Path.from_beziers(curves, closed=closed)


def test_a_path_has_points_every_two_centimetres(monkeypatch: pytest.MonkeyPatch) -> None:
    path = Path.from_beziers([STRAIGHT])
    assert len(path.points_m) == 151
    assert path.length_m == pytest.approx(3.0)
    np.testing.assert_allclose(path.points_m[:, 0], 0.02 * np.arange(151), atol=1e-9)
    tiny = np.linspace((0.0, 0.0), (0.001, 0.0), 4)
    assert len(Path.from_beziers([tiny]).points_m) == 2
    back = np.linspace((0.001, 0.0), (0.0, 0.0), 4)
    assert len(Path.from_beziers([tiny, back], closed=True).points_m) == 3
    monkeypatch.setattr("robot.navigation.path.SPACING_M", 0.5)
    assert len(Path.from_beziers([STRAIGHT]).points_m) == 7


def test_the_length_of_a_bend_is_that_of_its_curve() -> None:
    """By Simpson's rule over the speed along the Bezier."""
    curve = np.array([[0.0, 0.0], [0.4, 0.0], [0.6, 0.2], [0.6, 0.6]])
    t = np.linspace(0.0, 1.0, 2001)
    speeds = np.hypot(*(bezier_tangents(curve, t).T))
    weights = np.where(np.arange(2001) % 2, 4.0, 2.0)
    weights[[0, -1]] = 1.0
    length_m = float((weights * speeds).sum()) / (3.0 * 2000)
    path = Path.from_beziers([curve])
    assert path.length_m == pytest.approx(length_m, rel=2e-5)
    middle = path.pose_at(0.5 * path.length_m)
    assert middle.x_m + middle.y_m == pytest.approx(0.6, abs=2e-4)
    assert middle.heading_rad == pytest.approx(math.pi / 4.0, abs=2e-3)


def test_positions_beyond_an_open_path_and_beside_it() -> None:
    batch = PathBatch([Path.from_beziers([STRAIGHT])])
    points = batch.points_at(np.array([[-0.5, 0.25, 3.5]]))[0]
    np.testing.assert_allclose(points, [[-0.5, 0.0], [0.25, 0.0], [3.5, 0.0]], atol=1e-9)
    found = batch.project(np.array([[0.25, -0.1]]))
    assert (found.arc_m[0], found.offset_m[0]) == pytest.approx((0.25, -0.1))
    assert found.index[0] == 12
    assert batch.advance_m(np.array([2.9]), np.array([0.1]))[0] == pytest.approx(-2.8)
    loop = lane_loop(load_map("loop"))
    around = loop.batch.advance_m(np.array([loop.length_m - 0.1]), np.array([0.2]))
    assert around[0] == pytest.approx(0.3)
    back = loop.batch.advance_m(np.array([0.2]), np.array([loop.length_m - 0.1]))
    assert back[0] == pytest.approx(-0.3)


@pytest.mark.parametrize("name", ["arena", "loop"])
def test_the_nearest_points_of_all_lanes_by_trying_many(name: str) -> None:
    road_map = load_map(name)
    index, rng = LaneIndex(road_map.lanes), np.random.default_rng(0)
    t = np.linspace(0.0, 1.0, 4001)
    for x_m, y_m in rng.uniform(0.1, 2.0, (6, 2)).tolist():
        found = index.near(x_m, y_m)
        for k, lane in enumerate(road_map.lanes):
            points = bezier_points(lane.control_points_m, t)
            away_m = np.hypot(points[:, 0] - x_m, points[:, 1] - y_m)
            best = int(away_m.argmin())
            assert found.distance_m[k] == pytest.approx(away_m[best], abs=1e-4)
            along = bezier_tangents(lane.control_points_m, found.t[k : k + 1])[0]
            assert found.heading_rad[k] == pytest.approx(math.atan2(along[1], along[0]), abs=1e-9)
            at = bezier_points(lane.control_points_m, found.t[k : k + 1])[0]
            cross = along[0] * (y_m - at[1]) - along[1] * (x_m - at[0])
            assert found.offset_m[k] == pytest.approx(cross / math.hypot(*along), abs=1e-9)
            if 0.0 < t[best] < 1.0:
                assert abs(found.offset_m[k]) == pytest.approx(found.distance_m[k], abs=2e-3)


def test_a_route_is_cut_from_its_first_and_last_lane() -> None:
    graph = LaneGraph(load_map("arena"))
    first = 0
    end = graph.lane_nodes[first][1]
    _, last = graph.edges[end][0]
    route = route_between(graph, first, 0.25, last, 0.5)
    assert route.lanes == (first, last)
    assert route.cost == pytest.approx(0.75 + 0.5)
    for curve, lane, t in (
        (route.curves_m[0], first, (0.25, 1.0)),
        (route.curves_m[1], last, (0.0, 0.5)),
    ):
        control, u = graph.lanes[lane].control_points_m, np.linspace(0.0, 1.0, 7)
        expected = bezier_points(control, t[0] + (t[1] - t[0]) * u)
        np.testing.assert_allclose(bezier_points(curve, u), expected, atol=1e-9)
    within = route_between(graph, first, 0.25, first, 0.75)
    assert (within.lanes, within.cost) == ((first,), 0.0)
    assert route_between(graph, first, 1.0, last, 0.5).lanes == (last,)
    assert len(route_between(graph, first, 0.5, first, 0.25).lanes) > 2, "all the way round"


@pytest.mark.parametrize("turned_deg", [89.0, -89.0, 91.0, 180.0])
def test_a_robot_on_a_straight_road_takes_the_lane_that_it_faces_along(turned_deg: float) -> None:
    graph = LaneGraph(load_map("arena"))
    start = Pose(1.98, 0.6, math.radians(90.0 + turned_deg))
    route = plan_route(graph, start, (1.0, 2.55))
    lane = graph.lanes[route.lanes[0]].control_points_m
    assert bool(lane[3, 1] > lane[0, 1]) is (abs(turned_deg) < 90.0)
