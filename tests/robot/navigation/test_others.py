"""What overhead poses of everybody mean for one robot: the free way, and who is at a junction."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Dict, List, Tuple

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from robot.geometry import Pose
from robot.navigation.neighbours import AHEAD_M, Crossings, Other, Traveller, free_way
from robot.navigation.planner import LaneGraph, plan_path
from robot.navigation.road_map import load_map, read_map
from robot.safety.governors import Road, Rules, govern

EAST = np.stack((AHEAD_M, 0.0 * AHEAD_M), axis=1)
CROSS = read_map(
    {
        "tile_size": 0.6,
        "tiles": [
            ["grass", "straight/N", "grass"],
            ["straight/E", "4way", "straight/W"],
            ["grass", "straight/S", "grass"],
        ],
    },
    "cross",
)
NOSE_M, HALF_ROBOT_M, HALF_DUCK_M = 0.066, 0.09, 0.035
# On the arms S, E, N, W: the nose 5 cm before the crossing, in the right lane.
BEFORE_M = 0.6 - 0.05 - NOSE_M
WAITING = (
    Pose(1.02, BEFORE_M, 0.5 * math.pi),
    Pose(1.8 - BEFORE_M, 1.02, math.pi),
    Pose(0.78, 1.8 - BEFORE_M, -0.5 * math.pi),
    Pose(BEFORE_M, 0.78, 0.0),
)


@given(st.floats(0.2, 1.1), st.floats(-0.3, 0.3))
def test_the_way_to_a_leader_is_from_nose_to_tail(ahead_m: float, speed_mps: float) -> None:
    found = free_way(EAST, Pose(0.0, 0.0, 0.0), [Other(ahead_m, 0.02, speed_mps)])
    assert found.free_m == pytest.approx(ahead_m - HALF_ROBOT_M - NOSE_M, abs=0.011)
    assert found.coming_mps == pytest.approx(-speed_mps)


@pytest.mark.parametrize(
    ("other", "counts"),
    [
        (Other(-0.2, 0.0), False),  # behind
        (Other(0.4, 0.234), False),  # in the other lane
        (Other(0.4, 0.234, 0.0, -0.2), False),  # robots keep to their lanes
        (Other(0.4, 0.234, 0.0, -0.2, HALF_DUCK_M, True), True),  # a duck walks onto mine
        (Other(0.4, 0.234, 0.0, 0.2, HALF_DUCK_M, True), False),  # or away from it
        (Other(0.4, 0.13, half_m=HALF_DUCK_M), False),  # beside the lane
        (Other(0.4, 0.09, half_m=HALF_DUCK_M), True),
        (Other(1.5, 0.0), False),  # too far away to matter
    ],
)
def test_who_is_on_the_lane(other: Other, counts: bool) -> None:
    assert math.isfinite(free_way(EAST, Pose(0.0, 0.0, 0.0), [other]).free_m) is counts


def test_a_robot_beside_the_middle_of_its_lane_passes_nearer() -> None:
    duck = Other(0.15, 0.13, half_m=HALF_DUCK_M)
    assert free_way(EAST, Pose(0.0, 0.05, 0.0), [duck]).free_m < 0.1
    assert free_way(EAST, Pose(0.0, -0.05, 0.0), [duck]).free_m == math.inf


@pytest.mark.parametrize("side", [-1.0, 1.0])
@pytest.mark.parametrize("arc_m", [0.3, 0.4, 0.5])
def test_in_a_bend_the_way_is_that_of_the_lane(side: float, arc_m: float) -> None:
    radius_m = 0.2
    lane_m = np.stack((np.sin(AHEAD_M / radius_m), 1.0 - np.cos(AHEAD_M / radius_m)), axis=1)
    lane_m *= (radius_m, side * radius_m)
    there = Other(*lane_m[round(arc_m / 0.02)])
    leads = free_way(lane_m, Pose(0.0, 0.0, 0.0), [there])
    assert leads.free_m < arc_m - HALF_ROBOT_M - NOSE_M + 0.021
    outside = Other(radius_m + 0.19, side * radius_m)  # passes by on the other side of the road
    assert free_way(lane_m, Pose(0.0, 0.0, 0.0), [outside]).free_m == math.inf


def test_the_nearest_counts() -> None:
    two = [Other(0.8, 0.0), Other(0.5, 0.0)]
    assert free_way(EAST, Pose(0.0, 0.0, 0.0), two).free_m == pytest.approx(0.344, abs=0.011)


def travellers(speed_mps: float = 0.0, line_m: float = 0.05) -> Dict[str, Traveller]:
    return {f"r{arm}": Traveller(pose, speed_mps, line_m) for arm, pose in enumerate(WAITING)}


def test_who_stands_at_a_crossing_is_told_to_all_others_with_arm_and_arrival() -> None:
    crossings = Crossings(CROSS)
    assert crossings.update(1.0, travellers(speed_mps=0.2)) == {}
    assert crossings.update(2.0, travellers(line_m=0.2)) == {}
    some = travellers()
    del some["r2"]
    crossings.update(3.0, some)
    found = crossings.update(4.0, travellers())
    assert set(found) == {"r0", "r1", "r2", "r3"}
    for arm in range(4):
        at = found[f"r{arm}"]
        assert (at.own.arm, at.own.name, at.own.inside) == (arm, f"r{arm}", False)
        assert at.own.arrived_s == (4.0 if arm == 2 else 3.0)
        assert {other.name for other in at.others} == set(found) - {f"r{arm}"}


def test_a_robot_is_inside_from_its_nose_to_its_tail_and_keeps_its_arm() -> None:
    crossings, told = Crossings(CROSS), {}
    for k, y_m in enumerate(np.arange(0.4, 1.5, 0.02)):
        robot = Traveller(Pose(1.02, float(y_m), 0.5 * math.pi), 0.2, math.inf)
        told[float(y_m)] = crossings.update(0.1 * k, {"a": robot}).get("a")
    inside = [y for y, at in told.items() if at is not None and at.own.inside]
    assert min(inside) == pytest.approx(0.6 - NOSE_M + 0.02, abs=0.02)
    assert max(inside) == pytest.approx(1.2 + 0.1, abs=0.02)
    assert {at.own.arm for at in told.values() if at is not None} == {0}


@pytest.mark.parametrize(("stands_s", "inside"), [(0.0, [True]), (14.9, [True]), (15.1, [])])
def test_who_stands_inside_for_long_is_only_in_the_way(stands_s: float, inside: List[bool]) -> None:
    stuck = Traveller(Pose(1.02, 0.9, 0.5 * math.pi), 0.0, math.inf, stands_s)
    waits = Traveller(WAITING[0], 0.0, 0.05, 100.0)
    found = Crossings(CROSS).update(10.0, {"r0": waits, "stuck": stuck})
    assert [other.inside for other in found["r0"].others] == inside


@pytest.mark.parametrize(
    "here", [(3.585, 0.424, -2.4), (3.58, 0.42, -2.35), (3.57, 0.4, -2.4), (3.6, 0.44, -2.3)]
)
@pytest.mark.parametrize("sigma_m", [0.03, 0.05])
def test_who_swings_wide_before_one_that_waits_beside_its_lane_gets_by_slowly(
    here: Tuple[float, float, float], sigma_m: float
) -> None:
    """It turns right out of a junction, whose line on the left another keeps: both would wait."""
    pose, other = Pose(*here), Other(3.39, 0.17)
    path = plan_path(LaneGraph(load_map("town")), Pose(3.68, 0.95, -1.45), (2.9, 0.4))
    rules, told_mps, before_m, hint = Rules(headway=True).chain(), 0.0, math.inf, None
    fastest_mps = 0.0
    for turn in range(150):
        at = path.project(pose.x_m, pose.y_m, hint)
        hint = at.index
        way = free_way(path.batch.points_at(at.arc_m + AHEAD_M[None])[0], pose, [other], sigma_m)
        ahead = replace(way, free_sigma_m=max(way.free_sigma_m, sigma_m))
        rules, cap = govern(rules, Road(0.1 * turn, 0.0, told_mps, ahead))
        told_mps = min(0.24, cap.most_mps)
        if math.isfinite(way.free_m):
            fastest_mps = max(fastest_mps, told_mps)
        aim = pose.to_robot(np.array([path.pose_at(at.arc_m + 0.16)[:2]]))[0]
        bend_pm = float(np.clip(2.0 * aim[1] / (aim @ aim), -9.0, 9.0))
        pose = pose.moved(0.1 * told_mps, 0.1 * told_mps * bend_pm)
        before_m = min(before_m, math.dist(pose[:2], other[:2]))
        if at.arc_m > path.length_m - 0.15:
            break
    assert at.arc_m > path.length_m - 0.15, "both wait for ever"
    assert before_m > 0.19
    assert fastest_mps <= 0.04 + 1e-9


def test_who_stands_on_its_lane_is_no_less_in_its_way_for_a_swing() -> None:
    comes = Other(0.5, 0.18, -0.2)  # whoever drives may come nearer yet
    for other, unsure in ((Other(0.5, 0.16), False), (Other(0.5, 0.18), True), (comes, False)):
        way = free_way(EAST, Pose(0.0, 0.0, 0.35), [other])
        assert math.isfinite(way.free_m)
        assert (way.free_sigma_m > 0.08) is unsure
