"""Where lines lie on tiles of each kind; tiles are 1 m wide here."""

from __future__ import annotations

import math
from typing import Tuple

import numpy as np
import pytest

from robot.navigation.road_map import read_map
from robot.navigation.road_paint import RoadPaint, bent_lane, road_paint

CORNERS = [(x, y) for x in (0.0, 1.0) for y in (0.0, 1.0)]


def painted(tile: str) -> RoadPaint:
    grid = [["floor"] * 3, ["floor", tile, "floor"], ["floor"] * 3]
    return road_paint(read_map({"tile_size": 1.0, "tiles": grid}, "one"))


def at(paint: RoadPaint, x_m: float, y_m: float) -> Tuple[float, float, float]:
    """White, yellow and known at a place on the middle tile, from its south-west corner."""
    white, yellow, known = paint.at(np.array([1.0 + x_m]), np.array([1.0 + y_m]))[0].tolist()
    return white, yellow, known


def test_a_straight_road_has_white_edges_and_a_yellow_middle() -> None:
    paint = painted("straight/E")
    for x_m in (0.1, 0.5, 0.9):
        white, yellow, known = at(paint, x_m, 0.5)
        assert (white < 0.05, yellow > 0.4, known) == (True, True, 1.0)
        for edge_m in (0.068, 0.932):
            white, yellow, known = at(paint, x_m, edge_m)
            assert (white > 0.8, yellow < 0.05, known) == (True, True, 1.0)
        for lane_m in (0.3, 0.7):
            assert max(at(paint, x_m, lane_m)[:2]) < 0.05


def test_what_is_no_road_is_not_known() -> None:
    paint = painted("straight/E")
    assert at(paint, 0.5, 1.5)[2] == 0.0
    assert at(paint, 40.0, -40.0) == (0.0, 0.0, 0.0)


@pytest.mark.parametrize(
    ("tile", "corner"),
    [
        ("curve_left/W", (1.0, 0.0)),
        ("curve_left/N", (0.0, 0.0)),
        ("curve_left/E", (0.0, 1.0)),
        ("curve_left/S", (1.0, 1.0)),
    ],
)
def test_a_curve_bends_about_one_corner(tile: str, corner: Tuple[float, float]) -> None:
    paint = painted(tile)
    along = np.radians(np.linspace(5.0, 85.0, 9))
    towards = np.sign(0.5 - np.array(corner))
    arc = np.array(corner) + 0.5 * towards * np.stack((np.cos(along), np.sin(along)), axis=-1)
    inner = [
        np.array((x, y)) + 0.068 * np.sign((0.5 - x, 0.5 - y)) / math.sqrt(2.0) for x, y in CORNERS
    ]
    whites = [at(paint, *point)[0] for point in inner]
    assert CORNERS[int(np.argmax(whites))] == corner
    assert np.mean([at(paint, *point)[1] for point in arc]) > 0.15


def test_a_junction_has_white_corners_no_yellow_and_unknown_stop_lines() -> None:
    paint = painted("4way")
    assert paint.cover[..., 1].max() == 0.0
    for x, y in CORNERS:
        inner = np.array((x, y)) + 0.068 * np.sign((0.5 - x, 0.5 - y)) / math.sqrt(2.0)
        assert at(paint, *inner)[0] > 0.5
    assert at(paint, 0.5, 0.5) == (0.0, 0.0, 1.0)
    for stop in ((0.3, 0.05), (0.7, 0.95), (0.05, 0.3), (0.95, 0.7)):
        assert at(paint, *stop)[2] == 0.0


@pytest.mark.parametrize(
    ("tile", "closed", "opened"),
    [
        ("3way_left/S", (0.068, 0.5), (0.932, 0.5)),
        ("3way_left/E", (0.5, 0.068), (0.5, 0.932)),
        ("3way_left/N", (0.932, 0.5), (0.068, 0.5)),
        ("3way_right/S", (0.932, 0.5), (0.068, 0.5)),
    ],
)
def test_a_t_junction_has_an_edge_along_its_closed_side_only(
    tile: str, closed: Tuple[float, float], opened: Tuple[float, float]
) -> None:
    paint = painted(tile)
    assert at(paint, *closed)[0] > 0.8
    assert at(paint, *opened)[0] < 0.05


@pytest.mark.parametrize("bend_pm", [0.0, 2.0, -2.0])
def test_the_lines_beside_a_lane_have_soft_edges_and_end_where_nothing_is_known(
    bend_pm: float,
) -> None:
    """Paint 5 and 2.5 cm wide, beside the middle of a mat's lane; also half a radian on."""
    left_m = (-0.1357, -0.1107, -0.1032, 0.0, 0.117, 0.1295, 0.3697, -0.254, -0.257, 0.451)
    white = (1.0, 0.5, 0.25, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0)
    yellow = (0.0, 0.0, 0.0, 0.0, 0.587, 0.32, 0.0, 0.0, 0.0, 0.0)
    known = (1, 1, 1, 1, 1, 1, 1, 1, 0, 0)
    points_m = np.stack((np.zeros(10), left_m), axis=-1)
    if bend_pm:
        turned = math.copysign(0.5, bend_pm)
        radii_m = 1.0 / bend_pm - np.array(left_m)
        points_m = np.stack(
            (radii_m * math.sin(turned), 1.0 / bend_pm - radii_m * math.cos(turned)), axis=-1
        )
    seen = bent_lane(points_m[None], bend_pm)[0]
    np.testing.assert_allclose(seen, np.stack((white, yellow, known), axis=-1), atol=0.002)
