"""The ten angles: range, sign, symmetry, and one implementation for one robot and for many."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from robot.contract import PATH_ANGLE_LIMIT_RAD, PATH_POINTS
from robot.geometry import Pose
from robot.navigation.path import (
    FIRST_POINT_M,
    POINT_SPACING_M,
    Path,
    PathBatch,
    lane_loop,
    path_input,
    path_inputs,
)
from robot.navigation.road_map import load_map

LOOP = lane_loop(load_map("loop"))
STRAIGHT = Path.from_beziers([np.array([[0.0, 0.0], [1.0, 0.0], [2.0, 0.0], [3.0, 0.0]])])


@given(
    x=st.floats(0.5, 2.0), offset=st.floats(-0.05, 0.05), heading=st.floats(-0.2, 0.2)
)  # fmt: skip
def test_angles_to_a_straight_path(x: float, offset: float, heading: float) -> None:
    ahead = FIRST_POINT_M + POINT_SPACING_M * np.arange(PATH_POINTS)
    expected = np.arctan2(-offset, ahead) - heading
    limited = np.clip(expected, -PATH_ANGLE_LIMIT_RAD, PATH_ANGLE_LIMIT_RAD)
    found = path_input(STRAIGHT, Pose(x, offset, heading))
    np.testing.assert_allclose(found, limited / PATH_ANGLE_LIMIT_RAD, atol=1e-5)


@given(x=st.floats(-1, 4), y=st.floats(-1, 3), heading=st.floats(-math.pi, math.pi))
def test_always_ten_numbers_between_minus_one_and_one(x: float, y: float, heading: float) -> None:
    found = path_input(LOOP, Pose(x, y, heading))
    assert found.shape == (PATH_POINTS,)
    assert found.dtype == np.float32
    assert np.all(np.abs(found) <= 1.0)


def test_a_left_bend_is_positive_and_a_robot_turned_left_sees_the_path_to_its_right() -> None:
    bend = np.flatnonzero(np.diff(LOOP.headings_rad) > 0.03)[0]
    assert path_input(LOOP, LOOP.pose_at(LOOP.arc_m[bend]))[-1] > 0.1
    assert np.all(path_input(STRAIGHT, Pose(1.0, 0.0, 0.3)) < 0.0)


def test_the_end_of_a_path_goes_on_straight() -> None:
    np.testing.assert_allclose(path_input(STRAIGHT, Pose(2.99, 0.0, 0.0)), 0.0, atol=1e-6)


@pytest.mark.parametrize("seed", range(3))
def test_a_batch_equals_single_robots(seed: int) -> None:
    rng = np.random.default_rng(seed)
    paths = [LOOP, STRAIGHT, LOOP]
    poses = rng.uniform((0, 0, -3), (3, 2, 3), (3, 3))
    for batch, chosen in ((PathBatch(paths), paths), (PathBatch([LOOP]), [LOOP] * 3)):
        positions = batch.project(poses[:, :2])
        found = path_inputs(batch, poses, positions.arc_m)
        for i, path in enumerate(chosen):
            one = path_input(path, Pose(*poses[i]), hint=int(positions.index[i]))
            np.testing.assert_allclose(found[i], one, atol=1e-6)
