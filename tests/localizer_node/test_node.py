import math

import numpy as np
import pytest

from localizer_node.calibration import Marker
from localizer_node.node import Localizer, locate_frame
from robot.errors import ContractError
from tests.localizer_node.rigs import Rig, turn

RIG = Rig(tilt_rad=(0.04, 0.02))
ROBOTS = (Marker("a"), Marker("b", front="magenta"))


def drawn(i):
    """Two robots on their way, and where they are."""
    t = i / 30.0
    places = {
        "a": (0.5 + 0.3 * t, 0.8, 0.0),
        "b": (1.3 + 0.4 * math.sin(t), 1.9 - 0.4 * math.cos(t), t),
    }
    picture = RIG.floor()
    for marker in ROBOTS:
        RIG.paint_robot(picture, marker, places[marker.robot])
    return picture, places


def test_one_picture():
    picture, places = drawn(0)
    found = locate_frame(picture, RIG.calibration(ROBOTS))
    assert {d.robot for d in found} == {"a", "b"}
    assert [d.confidence for d in found] == sorted((d.confidence for d in found), reverse=True)
    for d in found:
        assert (d.x_m, d.y_m) == pytest.approx(places[d.robot][:2], abs=0.004)


def test_robots_are_followed_and_published():
    published = []
    localizer = Localizer(RIG.calibration(ROBOTS))
    for i in range(30):
        picture, places = drawn(i)
        poses = localizer.feed(picture, i / 30.0)
        published.append(poses)
        assert len(poses) == (2 if i >= 2 else 0)
        for pose in poses:
            x, y, heading = places[pose.robot]
            assert math.hypot(pose.x_m - x, pose.y_m - y) < 0.006
            assert turn(pose.heading_rad, heading) < math.radians(2.0)
    assert [len(poses) for poses in published] == [0, 0] + [2] * 28


def pictured(marker, pose, seed=None):
    """A robot at rest as a sensor sees it: no two pictures are the same."""
    picture = RIG.floor()
    RIG.paint_robot(picture, marker, pose)
    grain = np.random.default_rng(seed).integers(-2, 3, picture.shape)
    return np.clip(picture + grain, 0, 255).astype(np.uint8)


def flickering(picture, i):
    flickers = picture.copy()
    flickers[5, 7] = i % 2 * 200
    return flickers


@pytest.mark.parametrize("again", [lambda picture, _: picture.copy(), flickering])
def test_a_picture_that_repeats_the_last_one_has_no_poses(again):
    told = []
    localizer = Localizer(RIG.calibration(ROBOTS[:1]))
    live = [pictured(ROBOTS[0], (0.5, 0.5 + 0.01 * i, 0.5)) for i in range(12)]
    frozen = [again(live[5], i) for i in range(20)]
    for i, picture in enumerate([*live[:6], *frozen, *live[6:]]):
        told.append(len(localizer.feed(picture, i / 30.0)))
    assert told[:6] == [0, 0, 1, 1, 1, 1]
    assert told[6] <= 1, "a flicker may begin with a change"
    assert told[7:26] == [0] * 19
    assert told[-3:] == [1] * 3


def test_a_robot_at_rest_is_told_where_only_noise_changes():
    localizer = Localizer(RIG.calibration(ROBOTS[:1]))
    told = [len(localizer.feed(pictured(ROBOTS[0], (0.5, 0.5, 0.5)), i / 30.0)) for i in range(9)]
    assert told == [0, 0] + [1] * 7


def test_a_robot_that_was_carried_off_is_found_again():
    localizer = Localizer(RIG.calibration(ROBOTS[:1]))

    def at(x, y):
        return pictured(ROBOTS[0], (x, y, 0.5))

    for i in range(5):
        assert len(localizer.feed(at(0.5, 0.5), i / 30.0)) == (i >= 2)
    for i in range(5, 20):
        poses = localizer.feed(at(1.8, 2.2), i / 30.0)
    assert (poses[0].x_m, poses[0].y_m) == pytest.approx((1.8, 2.2), abs=0.005)


@pytest.mark.parametrize("bad", [np.zeros((720, 1280, 3), np.uint8), np.zeros((1280, 1280, 3))])
def test_a_picture_of_another_size_is_refused(bad):
    with pytest.raises(ContractError, match=r"expected \(1280, 1280, 3\) uint8 RGB"):
        locate_frame(bad, RIG.calibration())
    with pytest.raises(ContractError, match="as calibrated"):
        Localizer(RIG.calibration()).feed(bad, 0.0)
