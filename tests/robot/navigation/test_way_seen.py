import math

import numpy as np
import pytest

from robot.geometry import Pose
from robot.link.messages import PoseMessage
from robot.navigation.lane_view import LaneView
from robot.navigation.neighbours import Neighbours
from robot.navigation.road_map import load_map
from robot.navigation.road_watch import CLEAR, FRESH_S, RoadWatch, WaySeen
from robot.safety.road_ahead import RoadAhead
from robot.vision.sight import COLUMNS, Seen, as_seen
from tests.robot.navigation.test_lane_view import CROSS, EASTWARDS_M
from tests.robot.navigation.test_neighbours import HERE, WAY


def picture(thing: float, free_m: float = 0.3) -> Seen:
    row = dict.fromkeys(COLUMNS, 0.0)
    row.update(thing=thing, free_m=free_m, sd_free_m=0.02)
    return as_seen(np.array([list(row.values())]))


def test_what_is_seen_comes_nearer_as_the_wheels_turn() -> None:
    way = WaySeen()
    way.see(picture(0.9), 1.0, 0.0)
    assert way.ahead(1.1, 0.1) == RoadAhead(0.3 - (1.1 - 1.0), 0.02)


def test_it_is_forgotten_only_after_several_pictures_without_it() -> None:
    way = WaySeen()
    way.see(picture(0.9), 0.0, 0.0)
    for _ in range(CLEAR - 1):
        way.see(picture(0.1), 0.0, 0.0)
        assert way.ahead(0.0, 0.0).free_m == 0.3
    way.see(picture(0.1), 0.0, 0.0)
    assert way.ahead(0.0, 0.0).free_m == math.inf


def test_what_was_sure_still_stands_there_when_pictures_doubt_it() -> None:
    way = WaySeen()
    way.see(picture(0.75), 0.0, 0.0)
    assert way.ahead(0.0, 0.0).free_m == math.inf
    for thing in (0.85, 0.55, 0.55, 0.55, 0.55):
        way.see(picture(thing), 0.0, 0.0)
        assert way.ahead(0.0, 0.0).free_m == 0.3
    for _ in range(CLEAR):
        way.see(picture(0.45), 0.0, 0.0)
    assert way.ahead(0.0, 0.0).free_m == math.inf
    way.see(picture(0.75), 0.0, 0.0)
    assert way.ahead(0.0, 0.0).free_m == math.inf


def test_the_newest_picture_counts_whatever_was_before() -> None:
    way = WaySeen()
    way.see(picture(0.9, 0.3), 0.0, 0.0)
    way.see(picture(0.9, 0.2), 0.05, 0.1)
    assert way.ahead(0.05, 0.1).free_m == 0.2


def test_without_a_fresh_picture_nothing_is_known() -> None:
    way = WaySeen()
    assert math.isnan(way.ahead(0.0, 0.0).free_m)
    way.see(picture(0.1), 0.0, 1.0)
    assert way.ahead(0.0, 1.0 + FRESH_S).free_m == math.inf
    assert math.isnan(way.ahead(0.0, 1.01 + FRESH_S).free_m)


def test_sight_tells_without_overhead_poses_and_of_both_the_nearer_counts() -> None:
    view = LaneView(load_map("loop"))
    poses = Neighbours(view, "robot")
    watch = RoadWatch(view, poses, WaySeen())

    def free_m() -> float:
        return watch.look(1.0, 0.0, (HERE, 0.05), WAY).free_m

    assert math.isnan(free_m()), "neither heard nor seen"
    watch.saw(picture(0.1), 0.0, 1.0)
    assert free_m() == math.inf
    watch.saw(picture(0.9, 0.3), 0.0, 1.0)
    assert free_m() == 0.3
    stamp = (7.0, "a" * 16, 1, 7.0)
    for other_m in (0.3, 0.9):
        other = PoseMessage("other", HERE.x_m + other_m, HERE.y_m, 0.0, 0.9, *stamp)
        poses = watch.others = Neighbours(view, "robot")
        poses.hear([PoseMessage("robot", *HERE, 0.9, *stamp), other], 1.0)
        expected = 0.3 if other_m > 0.5 else other_m - 0.09 - 0.066
        assert free_m() == pytest.approx(expected, abs=0.011)


def lined(offset_m: float = 0.0) -> Seen:
    """A red line 40 cm before the axle."""
    row = dict.fromkeys(COLUMNS, 0.0)
    row.update(line=0.9, road=0.9, line_m=0.4, offset_m=offset_m)
    return as_seen(np.array([list(row.values())]))


def test_red_lines_are_the_maps_where_the_place_is_known_to_twelve_centimetres() -> None:
    watch, here = RoadWatch(LaneView(CROSS)), Pose(0.3, EASTWARDS_M, 0.0)
    assert watch.look(0.0, 1.0).line_m is None
    watch.saw(lined(), 1.0, 0.0)
    for place, line_m in (((here, 0.12), 0.3), ((here, 0.121), 0.4), (None, 0.4)):
        assert watch.look(0.0, 1.0, place).line_m == pytest.approx(line_m - 0.066, abs=1e-3)
    assert watch.look(0.1, 1.1).line_m == pytest.approx(0.3 - 0.066), "it came nearer"
    watch.saw(lined(0.2), 1.0, 0.0)
    assert watch.look(0.0, 1.0).line_m is None, "that is the oncoming lane's"


def test_what_is_seen_before_one_that_comes_nearer_does_not_come_with_it() -> None:
    view = LaneView(load_map("loop"))
    poses = Neighbours(view, "robot")
    watch = RoadWatch(view, poses, WaySeen())
    for k in range(6):
        stamp = (7.0 + 0.1 * k, "a" * 16, k, 7.0 + 0.1 * k)
        other = PoseMessage("other", HERE.x_m + 0.9 - 0.02 * k, HERE.y_m, 3.1, 0.9, *stamp)
        poses.hear([PoseMessage("robot", *HERE, 0.9, *stamp), other], 1.0 + 0.1 * k)
    for thing, coming_mps in ((0.1, 0.2), (0.9, 0.0)):
        watch.saw(picture(thing, 0.3), 0.0, 1.5)
        told = watch.look(1.5, 0.0, (HERE, 0.05), WAY)
        assert told.coming_mps == pytest.approx(coming_mps, abs=1e-6)
