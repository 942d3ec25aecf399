import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from localizer_node.calibration import Board, Marker
from localizer_node.detect import Detector, Part, _front_fit
from tests.localizer_node.rigs import MAP_M, PINHOLE, Rig, turn

TWO_COLOUR = (Marker("green"), Marker("pink", front="magenta"))
TAGGED = (Marker("seven", "tag", tag=7), Marker("nine", "tag", tag=9))
PLAIN = (Marker("blue", "plain", board=Board(0.18, 0.11)),)
poses = st.tuples(
    st.floats(0.15, MAP_M[0] - 0.15), st.floats(0.15, MAP_M[1] - 0.15), st.floats(-3.1, 3.1)
)


def look(robots, placed, rig=Rig(tilt_rad=(0.03, -0.05)), clutter=()):  # noqa: B008
    picture = rig.floor()
    for pose, rect in clutter:
        rig.paint(picture, "blue", pose, rect)
    for marker, pose in placed:
        rig.paint_robot(picture, marker, pose)
    return picture, Detector(rig.calibration(robots))


@pytest.mark.parametrize("robots", [TWO_COLOUR, TAGGED], ids=["two_colour", "tag"])
@given(pose=poses, which=st.integers(0, 1))
@settings(max_examples=25, deadline=None)
def test_a_robot_is_found_where_it_stands(robots, pose, which):
    picture, detector = look(robots, [(robots[which], pose)])
    (found,) = detector.detect(picture)
    assert found.robot == robots[which].robot
    assert math.hypot(found.x_m - pose[0], found.y_m - pose[1]) < 0.004
    assert turn(found.heading_rad, pose[2]) < math.radians(2.0)
    assert found.confidence > 0.8


@given(pose=poses)
@settings(max_examples=25, deadline=None)
def test_a_plain_board_gives_its_place(pose):
    picture, detector = look(PLAIN, [(PLAIN[0], pose)])
    (found,) = detector.detect(picture)
    assert (found.robot, found.heading_rad) == ("blue", None)
    assert math.hypot(found.x_m - pose[0], found.y_m - pose[1]) < 0.004


PALE = {"blue": (105, 130, 200), "green": (110, 190, 130), "magenta": (190, 100, 165)}


@pytest.mark.parametrize("robots", [TWO_COLOUR, TAGGED, PLAIN], ids=["two_colour", "tag", "plain"])
@pytest.mark.parametrize("floor", PALE)
@given(pose=poses, noise=st.integers(0, 12))
@settings(max_examples=8, deadline=None)
def test_a_robot_is_found_once_on_a_floor_of_a_paler_shade_of_its_board(robots, floor, pose, noise):
    rig = Rig(tilt_rad=(0.03, -0.05))
    picture = rig.floor()
    grain = np.random.default_rng(noise).integers(-noise, noise + 1, picture.shape)
    picture[:] = np.clip(PALE[floor] + grain, 0, 255)
    rig.paint_robot(picture, robots[0], pose)
    (found,) = Detector(rig.calibration(robots[:1])).detect(picture)
    assert math.hypot(found.x_m - pose[0], found.y_m - pose[1]) < 0.006


def test_a_robot_on_a_road_within_a_lawn_of_its_boards_colour_is_found_once():
    rig = Rig()
    picture = rig.floor()
    road = picture[300:900, 300:900].copy()
    picture[:] = PALE["blue"]
    picture[300:900, 300:900] = road
    rig.paint_robot(picture, PLAIN[0], (1.1, 1.3, 0.5))
    assert len(Detector(rig.calibration(PLAIN)).detect(picture)) == 1


@pytest.mark.parametrize("kind", ["two_colour", "tag"])
def test_the_origin_is_under_the_axle_not_under_the_board(kind):
    robots = (Marker("r", kind, board=Board(forward_m=-0.04)),)
    picture, detector = look(robots, [(robots[0], (1.3, 0.9, 2.0))])
    (found,) = detector.detect(picture)
    assert (found.x_m, found.y_m) == pytest.approx((1.3, 0.9), abs=0.004)


def test_robots_with_boards_at_their_own_heights():
    robots = (
        Marker("low", board=Board(height_m=0.06)),
        Marker("high", front="magenta", board=Board(height_m=0.3)),
    )
    places = [(0.3, 0.4, 0.0), (1.9, 2.3, 2.5)]
    picture, detector = look(robots, list(zip(robots, places)))
    found = {d.robot: d for d in detector.detect(picture)}
    for marker, pose in zip(robots, places):
        one = found[marker.robot]
        assert math.hypot(one.x_m - pose[0], one.y_m - pose[1]) < 0.01


def test_blue_that_is_no_board_is_no_robot():
    clutter = [
        ((0.4, 0.4, 0.3), (-0.25, 0.25, -0.2, 0.2)),  # too large
        ((1.5, 0.5, 0.8), (-0.03, 0.03, -0.03, 0.03)),  # too small
        ((1.6, 1.5, 1.0), (-0.3, 0.3, -0.012, 0.012)),  # tape
        ((-0.2, 1.5, 0.0), (-0.08, 0.08, -0.07, 0.07)),  # a board's size, beside the map
        ((0.6, 2.1, 0.0), (-0.09, 0.09, -0.08, -0.04)),  # an L
        ((0.6, 2.1, 0.0), (-0.09, -0.05, -0.08, 0.08)),
    ]
    for robots in (TWO_COLOUR, TAGGED, PLAIN):
        pose = (1.7, 2.2, -1.0)
        picture, detector = look(robots, [(robots[0], pose)], clutter=clutter)
        found = detector.detect(picture)
        assert [d.robot for d in found] == [robots[0].robot]
        assert math.hypot(found[0].x_m - pose[0], found[0].y_m - pose[1]) < 0.004


def test_a_board_without_its_front_colour_is_no_two_coloured_robot():
    blue_only = Marker("x", "plain", board=Board(length_m=0.1))
    picture, detector = look(TWO_COLOUR, [(blue_only, (1.0, 1.0, 0.0))])
    assert detector.detect(picture) == ()


@pytest.mark.parametrize(("away_m", "fits"), [(0.08, 1.0), (0.099, 0.3), (0.101, 0.0), (0.0, 0.0)])
def test_a_front_lies_as_far_from_its_rear_as_it_should_to_a_quarter(away_m, fits):
    """Half a board's length of 16 cm is between their middles."""
    rear = Part(np.zeros(2), (0.14, 0.1), 1.0, (0.0, 0.0))
    front = Part(np.array([0.0, away_m]), (0.14, 0.06), 1.0, (0.0, 0.0))
    assert _front_fit(TWO_COLOUR[0], rear, front) == pytest.approx(fits, abs=0.06)
    assert (_front_fit(TWO_COLOUR[0], rear, front) > 0.0) is (fits > 0.0)


def test_a_board_whose_tag_is_unknown_is_nobody():
    stranger = Marker("x", "tag", tag=33)
    picture, detector = look(TAGGED, [(stranger, (1.0, 1.0, 0.5))])
    assert detector.detect(picture) == ()


@pytest.mark.parametrize(("tag_m", "found"), [(0.2, 0), (0.117, 0), (0.108, 1), (0.063, 0)])
def test_a_tag_must_have_its_size_to_a_quarter(tag_m, found):
    other = Marker("x", "tag", tag=7, board=Board(0.4, 0.4, tag_m=tag_m))
    picture, detector = look(TAGGED, [(other, (1.2, 1.4, 0.7))])
    assert len(detector.detect(picture)) == found


def test_a_second_board_with_a_robot_s_tag_is_told_as_well():
    """What follows the robots then is in doubt; told one of them alone, it believed either."""
    placed = [(TAGGED[0], (1.0, 1.0, 0.5)), (TAGGED[0], (1.8, 0.4, 2.0))]
    picture, detector = look(TAGGED, placed)
    found = sorted((d.robot, round(d.x_m, 1)) for d in detector.detect(picture))
    assert found == [("seven", 1.0), ("seven", 1.8)]


def test_tags_side_by_side_are_told_once_each():
    placed = [(TAGGED[0], (1.0, 1.0, 0.5)), (TAGGED[1], (1.2, 1.0, 2.0))]
    picture, detector = look(TAGGED, placed)
    assert sorted(d.robot for d in detector.detect(picture)) == ["nine", "seven"]


@given(st.floats(-math.pi, math.pi))
@settings(max_examples=20, deadline=None)
def test_turning_the_camera_turns_no_robot(yaw):
    rig = Rig(PINHOLE, yaw_rad=yaw)
    pose = (0.6, 1.9, 1.0)
    picture, detector = look(TWO_COLOUR, [(TWO_COLOUR[0], pose)], rig)
    (found,) = detector.detect(picture)
    assert (found.x_m, found.y_m) == pytest.approx(pose[:2], abs=0.004)
    assert turn(found.heading_rad, pose[2]) < math.radians(2.0)


def test_the_region_of_interest_shuts_out_what_lies_beyond():
    from dataclasses import replace

    rig = Rig()
    picture, detector = look(TWO_COLOUR, [(TWO_COLOUR[0], (0.5, 0.5, 0.0))], rig)
    (found,) = detector.detect(picture)
    u, v = found.u_px, found.v_px
    away = ((u + 60.0, v - 300.0), (u + 400.0, v - 300.0), (u + 400.0, v + 100.0))
    fenced = replace(rig.calibration(TWO_COLOUR), roi_px=away)
    assert Detector(fenced).detect(picture) == ()


def test_no_robots_to_look_for():
    rig = Rig()
    assert Detector(rig.calibration(())).detect(rig.floor()) == ()
