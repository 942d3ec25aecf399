import math

import numpy as np
import pytest

from robot.geometry import Pose
from robot.navigation.lane_view import AHEAD_M, KINDS, LaneAhead, LaneView
from robot.navigation.planner import LaneGraph, path_on
from robot.navigation.road_map import RoadMap, read_map

TILE = 0.6


def map_of(*rows: str) -> RoadMap:
    return read_map({"tile_size": TILE, "tiles": [row.split() for row in rows]}, "drawn")


# A crossing in the middle; a street comes to it from the west, another bends to it from the south.
CROSS = map_of(
    "floor straight/S floor",
    "straight/E 4way straight/E",
    "floor straight/S floor",
)
EASTWARDS_M = 1.5 * TILE - 0.2 * TILE  # the right-hand lane of the middle row


def seen(road_map: RoadMap, x_m: float, y_m: float, heading_rad: float) -> LaneAhead:
    road = LaneView(road_map).at(x_m, y_m, heading_rad)
    assert road is not None
    return road


def test_a_robot_left_of_its_lane_and_turned_left_sees_both_positive() -> None:
    road = seen(CROSS, 0.2, EASTWARDS_M + 0.03, 0.1)
    assert road.offset_m == pytest.approx(0.03, abs=1e-3)
    assert road.heading_rad == pytest.approx(0.1, abs=1e-3)
    assert road.along_rad == pytest.approx(0.0, abs=1e-6)
    assert road.curvature_pm == pytest.approx(0.0, abs=1e-6)


def test_the_red_line_lies_where_the_junction_begins() -> None:
    road = seen(CROSS, 0.2, EASTWARDS_M, 0.0)
    assert road.line_m == pytest.approx(TILE - 0.2, abs=1e-3)
    assert KINDS[road.kind] == "cross"
    assert math.isnan(seen(CROSS, TILE - AHEAD_M + 0.01, EASTWARDS_M, 0.0).curvature_pm)


@pytest.mark.parametrize(
    ("tile", "kind"),
    [
        ("3way_left/E", "left"),
        ("3way_left/W", "right"),
        ("3way_left/N", "tee"),
        ("4way", "cross"),
        ("3way_left/S", "none"),  # closed to who comes
        ("straight/E", "none"),
    ],
)
def test_a_junction_is_known_by_the_ways_that_it_offers(tile: str, kind: str) -> None:
    assert KINDS[seen(map_of(f"straight/E {tile}"), 0.2, 0.3 * TILE, 0.0).kind] == kind


def test_in_a_junction_lanes_go_straight_on_and_change_half_way_through_a_turn() -> None:
    middle = 1.5 * TILE
    along = seen(CROSS, middle, EASTWARDS_M - 0.02, 0.2)
    assert along.in_junction
    assert (along.offset_m, along.heading_rad) == pytest.approx((-0.02, 0.2))
    across = seen(CROSS, middle, EASTWARDS_M, math.radians(50))
    assert across.along_rad == pytest.approx(0.5 * math.pi)
    assert across.offset_m == pytest.approx(0.2 * TILE)  # its lane runs 0.2 tiles farther east


def test_who_faces_across_or_stands_beside_the_road_sees_no_lane() -> None:
    view = LaneView(CROSS)
    assert view.at(0.2, 0.2, 0.0) is None
    assert view.at(-5.0, 0.0, 0.0) is None
    against = view.at(0.2, EASTWARDS_M, math.pi)
    assert against is not None
    assert against.offset_m > 0.2, "the lane meant is the one on the other side"


def test_a_bend_to_the_left_has_the_curvature_of_its_circle_and_turns_the_lane() -> None:
    drawn = map_of("curve_left/N", "straight/S")
    lanes = [e for e in drawn.lanes if (e.tile.row, e.tile.column) == (0, 0)]
    for lane in lanes:
        begin, end = lane.control_points_m[0], lane.control_points_m[3]
        first = lane.control_points_m[1] - begin
        road = seen(drawn, *(0.5 * (begin + end)).tolist(), math.atan2(first[1], first[0]))
        chord = end - begin
        turns_left = first[0] * chord[1] - first[1] * chord[0] > 0.0
        assert (road.bend_pm > 1.0) == turns_left
        assert (road.curvature_pm > 0.0) == turns_left


def test_curvature_ahead_grows_by_its_slope() -> None:
    view = LaneView(map_of("curve_left/E", "straight/N", "straight/N"))
    xs = 0.7 * TILE
    roads = [view.at(xs, y, 0.5 * math.pi) for y in np.arange(0.3, 1.2, 0.05)]
    pairs = [(a, b) for a, b in zip(roads, roads[1:]) if a is not None and b is not None]
    assert len(pairs) > 10
    for a, b in pairs:
        grown = 0.5 * (a.slope_pm2 + b.slope_pm2) * 0.05
        assert b.curvature_pm - a.curvature_pm == pytest.approx(grown, abs=0.25)


def test_the_way_follows_the_lane_and_goes_straight_over_a_junction() -> None:
    view, ahead_m = LaneView(CROSS), 0.02 * np.arange(61)
    way_m = view.way(Pose(0.2, EASTWARDS_M + 0.05, 0.2), ahead_m)
    assert way_m is not None
    np.testing.assert_allclose(way_m, np.stack((0.2 + ahead_m, 0.0 * ahead_m + EASTWARDS_M), 1))
    assert LaneView(CROSS).way(Pose(-1.0, 0.0, 0.0), ahead_m) is None


def test_the_way_stays_in_the_middle_of_a_bend() -> None:
    ring = LaneView(map_of("curve_left/W curve_left/N", "curve_left/S curve_left/E"))
    for heading in np.linspace(-3.0, 3.0, 13):
        x, y = TILE + 0.5 * math.sin(heading), TILE - 0.5 * math.cos(heading)
        way_m = ring.way(Pose(x, y, heading), 0.02 * np.arange(36))
        assert way_m is not None
        roads = [ring.at(*point, heading + 0.02 * k / 0.45) for k, point in enumerate(way_m)]
        assert max(abs(road.offset_m) for road in roads if road is not None) < 0.006
        assert all(road is not None for road in roads)


def test_a_junction_leads_on_to_the_next_where_both_are_open_and_who_goes_straight_on() -> None:
    for first, offered in (("4way", True), ("3way_left/N", False)):  # closed to the east
        road = seen(map_of(f"{first} 4way"), 0.5 * TILE, 0.3 * TILE, 0.0)
        assert road.in_junction
        assert (road.kind > 0) is math.isfinite(road.line_m) is offered
    view = LaneView(map_of("4way 4way"))
    for heading_rad, line_m in ((0.29, 0.5 * TILE), (0.31, math.inf), (-0.31, math.inf)):
        assert view.line_ahead_m(Pose(0.5 * TILE, 0.3 * TILE, heading_rad)) == line_m


def test_where_no_way_leads_straight_on_the_right_one_is_taken() -> None:
    graph = LaneGraph(map_of("floor straight/N", "straight/E 3way_left/N", "floor straight/N"))
    path = path_on(graph, Pose(0.2, EASTWARDS_M, 0.0), 1.0)
    assert path.headings_rad[-1] == pytest.approx(-0.5 * math.pi)
