import math

import numpy as np
import pytest

from localizer_node.calibration import Board, Marker
from localizer_node.detect import Detection
from localizer_node.track import CONFIRM_HITS, REACQUIRE_HITS, Tracker
from robot.errors import ContractError
from tests.localizer_node.rigs import Rig, turn

DT_S = 1.0 / 30.0


def seen(robot, x, y, heading=None, kind="two_colour", confidence=0.9):
    return Detection(robot, kind, x, y, heading, confidence, 0.0, 0.0)


def tracker(*markers):
    return Tracker(Rig().calibration(markers or (Marker("a"), Marker("b", front="magenta"))))


def feed(followed, pictures, start=0):
    """Each picture a list of detections; the poses of the last."""
    poses = ()
    for i, detections in enumerate(pictures, start=start):
        poses = followed.update(detections, i * DT_S)
    return {pose.robot: pose for pose in poses}


def line(robot, count, start=(0.5, 0.5), speed=0.3, heading=0.0, **more):
    step = speed * DT_S * np.array([math.cos(heading), math.sin(heading)])
    places = np.array(start) + np.arange(count)[:, None] * step
    return [[seen(robot, float(x), float(y), **more)] for x, y in places]


def test_a_pose_is_told_from_the_third_sighting_on():
    followed = tracker()
    for i in range(CONFIRM_HITS - 1):
        assert followed.update([seen("a", 1.0, 1.0, 0.0)], i * DT_S) == ()
    (pose,) = followed.update([seen("a", 1.0, 1.0, 0.0)], 2 * DT_S)
    assert pose.robot == "a"
    assert (pose.x_m, pose.y_m, pose.heading_rad) == pytest.approx((1.0, 1.0, 0.0))


def test_a_turning_robot_is_followed_without_lag():
    followed = tracker()
    for i in range(60):
        angle = 0.8 * i * DT_S
        place = (1 + 0.4 * math.sin(angle), 1 - 0.4 * math.cos(angle))
        (*_, pose) = (None, *followed.update([seen("a", *place, angle)], i * DT_S))
    assert math.dist((pose.x_m, pose.y_m), place) < 0.002
    assert turn(pose.heading_rad, angle) < 0.005


def test_a_robot_that_is_not_seen_is_not_told():
    followed = tracker()
    feed(followed, line("a", 10, heading=0.0))
    assert feed(followed, [[]], start=10) == {}


def test_a_false_sighting_far_off_is_not_believed():
    followed = tracker()
    feed(followed, [[seen("a", 1.0, 1.0, 0.0)]] * 20)
    assert feed(followed, [[seen("a", 1.6, 1.0, 0.0)]], start=20) == {}
    both = [seen("a", 1.6, 1.0, 0.0, confidence=1.0), seen("a", 1.0, 1.0, 0.0, confidence=0.4)]
    assert feed(followed, [both], start=21)["a"].x_m == pytest.approx(1.0, abs=0.01)


def test_a_robot_that_was_carried_is_found_again():
    followed = tracker()
    feed(followed, [[seen("a", 1.0, 1.0, 0.0)]] * 20)
    there = [[seen("a", 0.3, 2.0, 1.0)]]
    assert feed(followed, there * (REACQUIRE_HITS - 1), start=20) == {}
    pose = feed(followed, there * CONFIRM_HITS, start=30)["a"]
    assert (pose.x_m, pose.y_m, pose.heading_rad) == pytest.approx((0.3, 2.0, 1.0), abs=0.01)


def test_a_flicker_here_and_there_carries_nothing():
    followed = tracker()
    feed(followed, [[seen("a", 1.0, 1.0, 0.0)]] * 20)
    hops = [[seen("a", 0.3 + 0.4 * (i % 3), 2.0, 1.0)] for i in range(25)]
    assert feed(followed, hops, start=20) == {}


def test_two_alike_and_no_memory_of_either_is_nobody():
    pair = [seen("a", 0.5, 0.5, 0.0), seen("a", 1.5, 1.5, 0.0)]
    assert feed(tracker(), [pair] * 10) == {}


def test_time_must_pass():
    followed = tracker()
    followed.update([], 1.0)
    with pytest.raises(ContractError, match="one monotonic clock"):
        followed.update([], 1.0)


def test_a_lost_robot_is_forgotten_and_starts_afresh():
    followed = tracker()
    feed(followed, [[seen("a", 1.0, 1.0, 0.0)]] * 5)
    feed(followed, [[]] * 40, start=5)
    assert feed(followed, [[seen("a", 2.0, 2.0, 0.0)]] * 3, start=50)["a"].x_m == pytest.approx(2.0)


PLAIN = Marker("p", "plain", board=Board(0.18, 0.11))


def test_a_plain_board_has_a_place_and_no_heading():
    pose = feed(tracker(PLAIN), line("p", 30, (0.9, 0.9), 0.3, 0.4, kind="plain"))["p"]
    assert pose.heading_rad is None
    assert pose.x_m == pytest.approx(0.9 + 29 * 0.01 * math.cos(0.4), abs=0.01)


def test_an_origin_behind_the_board_swings_with_it():
    """Turning on the spot: the board's middle circles, the origin stands."""
    marker = Marker("a", board=Board(forward_m=0.05))
    pictures = [[seen("a", 1.0, 1.0, 1.5 * i * DT_S)] for i in range(60)]
    pose = feed(tracker(marker), pictures)["a"]
    assert (pose.x_m, pose.y_m) == pytest.approx((1.0, 1.0), abs=1e-3)


@pytest.mark.parametrize(
    ("after_s", "away_m", "told"),
    [
        (0.1, 0.14, True),
        (0.1, 0.16, False),
        (0.9, 0.78, True),
        (0.9, 0.80, False),
        (0.99, 0.0, True),
        (1.01, 0.0, False),  # forgotten: it must be seen three times again
    ],
)
def test_a_robot_is_where_it_can_have_driven_at_eight_tenths_of_a_metre_a_second(
    after_s, away_m, told
):
    followed = tracker()
    feed(followed, [[seen("a", 1.0, 1.0, 0.0)]] * 5)
    poses = followed.update([seen("a", 1.0, 1.0 + away_m, 0.0)], 4 * DT_S + after_s)
    assert bool(poses) is told


def test_eight_sightings_elsewhere_in_a_row_and_two_more_are_a_robot_that_was_carried():
    here, there = [seen("a", 1.0, 1.0, 0.0)], [seen("a", 0.3, 2.0, 1.0)]
    followed, told = tracker(), []
    for i, picture in enumerate([here] * 5 + [there] * 7 + [here] + [there] * 10):
        told.append([pose.x_m for pose in followed.update(picture, i * DT_S)])
    assert told == [[]] * 2 + [[1.0]] * 3 + [[]] * 7 + [[1.0]] + [[]] * 9 + [[0.3]]


def test_two_alike_elsewhere_carry_nothing():
    followed = tracker()
    feed(followed, [[seen("a", 1.0, 1.0, 0.0)]] * 5)
    two = [seen("a", 0.3, 2.0, 1.0), seen("a", 2.0, 0.3, 1.0)]
    assert feed(followed, [two] * 20, start=5) == {}


@pytest.mark.parametrize(("other", "told"), [(0.59, True), (0.61, False)])
def test_of_two_alike_one_that_is_half_as_sure_again_is_the_robot(other, told):
    pair = [seen("a", 1.5, 1.5, 0.0, confidence=other), seen("a", 0.5, 0.5, 0.0)]
    assert bool(feed(tracker(), [pair] * 3)) is told


@pytest.mark.parametrize(("hop_m", "carried"), [(0.045, True), (0.055, False)])
def test_sightings_within_five_centimetres_are_of_one_place(hop_m, carried):
    followed = tracker()
    feed(followed, [[seen("a", 1.0, 1.0, 0.0)]] * 5)
    hops = [[seen("a", 0.3 + hop_m * (i % 2), 2.0, 1.0)] for i in range(20)]
    assert bool(feed(followed, hops, start=5)) is carried
