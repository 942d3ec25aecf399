import math

import numpy as np
import pytest

from robot.navigation.lane_view import LaneView
from robot.navigation.map_objects import MapObject
from robot.navigation.neighbours import HALF_DUCK_M, HALF_ROBOT_M, Other
from robot.navigation.road_map import load_map
from robot.safety.governors import NOSE_M
from sim_pybullet.look import NOMINAL
from sim_pybullet.scenery.object_solids import object_solids
from sim_pybullet.tasks.navigation import Navigation
from sim_pybullet.traffic.lights import lamps
from trainer.sight.bystanders import Bystanders, half_m
from trainer.sight.pictures import FREE, ROBOTS, START_SPREAD, THING, drive, label

TOWN = load_map("town")
VIEW = LaneView(TOWN)
LANE = next(
    lane
    for lane in TOWN.lanes
    if lane.tile.kind == "straight"
    and np.allclose(lane.control_points_m[0, 1], lane.control_points_m[3, 1])
)
(X, Y), (TO_X, _) = LANE.control_points_m[[0, 3]]
WAY = math.copysign(1.0, TO_X - X)  # the lane leads east or west
POSE = (X + 0.01 * WAY, Y, 0.0 if WAY > 0.0 else math.pi)


def duck(ahead_m: float, left_m: float = 0.0) -> Other:
    return Other(POSE[0] + WAY * ahead_m, Y + WAY * left_m, half_m=HALF_DUCK_M)


@pytest.mark.parametrize("ahead_m", [0.15, 0.3, 0.5])
def test_a_duck_on_the_lane_leaves_the_way_from_nose_to_duck(ahead_m: float) -> None:
    found = label(VIEW, POSE, [duck(ahead_m)])
    assert found[THING] == 1.0
    assert found[FREE] == pytest.approx(ahead_m - HALF_DUCK_M - NOSE_M, abs=0.011)


@pytest.mark.parametrize("left_m", [-0.25, -0.14, 0.14, 0.25])
def test_a_duck_beside_the_lane_leaves_it_free(left_m: float) -> None:
    found = label(VIEW, POSE, [duck(0.3, left_m)])
    assert found[THING] == 0.0
    assert np.isnan(found[FREE])


def test_what_stands_at_the_edge_of_the_lane_is_nobodys_question() -> None:
    assert label(VIEW, POSE, [duck(0.3, 0.126)])[THING] == -1.0


def test_a_robot_that_cuts_the_corner_is_in_the_way_sooner_than_it_touches() -> None:
    def robot(left_m: float) -> float:
        place = Other(POSE[0] + WAY * 0.3, Y + WAY * left_m, half_m=HALF_ROBOT_M)
        return label(VIEW, POSE, [place])[THING]

    assert [robot(0.18), robot(-0.18), robot(0.2), robot(0.22)] == [1.0, 1.0, -1.0, 0.0]


def test_a_duck_far_ahead_or_behind_leaves_the_lane_free() -> None:
    assert label(VIEW, POSE, [duck(0.9), duck(-0.1)])[THING] == 0.0


def test_of_several_the_nearest_counts() -> None:
    both = label(VIEW, POSE, [duck(0.5), duck(0.3)])
    assert both[FREE] == label(VIEW, POSE, [duck(0.3)])[FREE]


def test_sizes_are_those_that_the_robot_reckons_with() -> None:
    duckling, robot = (
        object_solids(MapObject("", kind, 0.0, 0.0, 0.0, height_m))
        for kind, height_m in (("duckie", 0.08), ("duckiebot", 0.135))
    )
    assert half_m(duckling) == pytest.approx(HALF_DUCK_M, abs=0.002)
    assert half_m(robot) == pytest.approx(HALF_ROBOT_M, abs=0.003)
    assert math.isnan(half_m(lamps(0))), "nobody drives into a lamp above the road"


def test_bystanders_are_seen_near_and_far_and_never_driven_through() -> None:
    driven = drive(Bystanders([TOWN], ROBOTS, START_SPREAD, 5), [NOMINAL], 5, 60)
    free_m = driven.labels[driven.labels[:, THING] == 1.0, FREE]
    assert len(free_m) > 100
    assert free_m.min() > -0.12, "alongside at most"
    assert (free_m < 0.15).any()
    assert (free_m > 0.4).any()
    assert (driven.labels[:, THING] == 0.0).sum() > 100
    alone = drive(Navigation([TOWN], ROBOTS, START_SPREAD), [NOMINAL], 5, 5)
    assert (alone.labels[:, THING] != 1.0).all()
    assert np.isnan(alone.labels[:, FREE]).all()
