"""Lane poses against the reference simulator's figures and against brute force."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from robot.geometry import bezier_points, bezier_tangents, wrap_angle
from robot.navigation.road_map import load_map
from tests.sim_pybullet.lane_pose import lane_pose

TOWN = load_map("town")
SAMPLES = np.linspace(0.0, 1.0, 2001)
DENSE = np.array([bezier_points(lane.control_points_m, SAMPLES) for lane in TOWN.lanes])


def test_compat_equals_the_reference(data_dir: Path) -> None:
    maps = json.loads((data_dir / "oracle" / "lane_pose_reward.json").read_text())["maps"]
    for name, samples in maps.items():
        road_map = load_map(data_dir / "maps" / "duckietown" / f"{name}.yaml")
        for sample in samples:
            x_m, _, z_m = sample["pos"]
            pose = lane_pose(road_map, x_m, road_map.height_m - z_m, sample["angle"], compat=True)
            assert pose is not None
            assert pose.distance_m == pytest.approx(sample["dist"], abs=2e-6)
            assert pose.dot_dir == pytest.approx(sample["dot_dir"], abs=2e-6)
            assert math.degrees(pose.angle_rad) == pytest.approx(sample["angle_deg"], abs=2e-4)


@settings(max_examples=150, deadline=None)
@given(
    x=st.floats(0, TOWN.width_m, exclude_max=True),
    y=st.floats(0, TOWN.height_m, exclude_max=True),
    heading=st.floats(-math.pi, math.pi),
)
def test_nearest_lane_along_the_heading(x: float, y: float, heading: float) -> None:
    pose = lane_pose(TOWN, x, y, heading)
    if not TOWN.on_road(x, y):
        assert pose is None
        return
    assert pose is not None
    assert abs(pose.angle_rad) <= math.pi / 2
    distance = np.hypot(*np.moveaxis(DENSE - (x, y), -1, 0)).min(axis=1)
    t = SAMPLES[np.hypot(*np.moveaxis(DENSE - (x, y), -1, 0)).argmin(axis=1)]
    tangents = np.array(
        [bezier_tangents(lane.control_points_m, np.array([u]))[0]
         for lane, u in zip(TOWN.lanes, t, strict=True)]
    )  # fmt: skip
    angles = np.asarray(wrap_angle(heading - np.arctan2(tangents[:, 1], tangents[:, 0])))
    clearly_along = np.abs(angles) < math.pi / 2 - 0.05
    chosen = distance[[lane is pose.lane for lane in TOWN.lanes]]
    assert chosen[0] <= distance[clearly_along].min() + 2e-4
    assert abs(pose.distance_m) <= chosen[0] + 2e-4


@given(
    lane=st.integers(0, len(TOWN.lanes) - 1),
    t=st.floats(0.3, 0.7),
    offset=st.floats(-0.04, 0.04),
    turn=st.floats(-0.6, 0.6),
)
def test_offset_and_angle_are_positive_to_the_left(
    lane: int, t: float, offset: float, turn: float
) -> None:
    control = TOWN.lanes[lane].control_points_m
    point = bezier_points(control, np.array([t]))[0]
    tangent = bezier_tangents(control, np.array([t]))[0]
    tangent /= np.linalg.norm(tangent)
    place = point + offset * np.array([-tangent[1], tangent[0]])
    near = TOWN.lane_index.near(*place)
    assert near.offset_m[lane] == pytest.approx(offset, abs=3e-4)
    heading = math.atan2(tangent[1], tangent[0]) + turn
    pose = lane_pose(TOWN, *place, heading)
    assert pose is not None
    if pose.lane is TOWN.lanes[lane]:
        assert pose.angle_rad == pytest.approx(turn, abs=0.02)
        assert pose.dot_dir == pytest.approx(math.cos(pose.angle_rad))
