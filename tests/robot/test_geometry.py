import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from robot.geometry import (
    DifferentialDrive,
    Pose,
    Twist,
    between,
    bezier_points,
    bezier_tangents,
    carried,
    compose,
    ellipses_95,
    radius_95,
    uncompose,
    wrap_angle,
)

metres = st.floats(-10, 10)
angles = st.floats(-20, 20)
poses = st.builds(Pose, metres, metres, angles)


@given(angles)
def test_wrapped_angle_is_the_same_direction(angle: float) -> None:
    wrapped = wrap_angle(angle)
    assert -math.pi < wrapped <= math.pi
    assert math.isclose(math.cos(wrapped), math.cos(angle), abs_tol=1e-9)
    assert math.isclose(math.sin(wrapped), math.sin(angle), abs_tol=1e-9)


def test_half_turn_is_positive() -> None:
    assert wrap_angle(-math.pi) == math.pi
    assert np.array_equal(wrap_angle(np.array([-math.pi, 0.0])), [math.pi, 0.0])


@given(poses, metres, metres)
def test_robot_and_world_frames_are_inverse(pose: Pose, x: float, y: float) -> None:
    assert np.allclose(pose.to_robot(pose.to_world(np.array([x, y]))), [x, y], atol=1e-9)


@given(poses)
def test_left_of_the_robot_is_positive_y(pose: Pose) -> None:
    left = (pose.x_m - math.sin(pose.heading_rad), pose.y_m + math.cos(pose.heading_rad))
    assert np.allclose(pose.to_robot(np.array(left)), [0.0, 1.0], atol=1e-9)


@given(poses, st.floats(-1, 1), st.floats(-3, 3))
def test_an_arc_equals_many_small_ones(pose: Pose, forward: float, turn: float) -> None:
    small = pose
    for _ in range(50):
        small = small.moved(forward / 50, turn / 50)
    big = pose.moved(forward, turn)
    assert np.allclose(small[:2], big[:2], atol=1e-9)
    assert abs(wrap_angle(small.heading_rad - big.heading_rad)) < 1e-9


@given(poses, st.floats(-1, 1), st.floats(-1.5, 1.5))
def test_the_arc_to_a_pose_is_the_one_that_led_there(
    pose: Pose, forward: float, turn: float
) -> None:
    assert np.allclose(pose.arc_to(pose.moved(forward, turn)), (forward, turn), atol=1e-9)


@given(st.floats(-1, 1), st.floats(-5, 5), st.floats(0.05, 0.3))
def test_twist_survives_the_wheels(forward: float, turn: float, baseline: float) -> None:
    drive = DifferentialDrive(baseline_m=baseline)
    back = drive.twist(drive.wheels(Twist(forward, turn)))
    assert np.allclose(back, (forward, turn), atol=1e-9)


@given(st.lists(st.tuples(metres, metres), min_size=4, max_size=4), st.floats(0.01, 0.99))
def test_bezier_tangent_is_the_derivative(control: list, t: float) -> None:
    p, h = np.array(control), 1e-6
    numeric = (bezier_points(p, np.array([t + h])) - bezier_points(p, np.array([t - h]))) / (2 * h)
    assert np.allclose(bezier_tangents(p, np.array([t])), numeric, atol=1e-4)


def test_bezier_ends_at_its_end_points() -> None:
    control = np.array([[0.0, 0.0], [1.0, 2.0], [3.0, 2.0], [4.0, 0.0]])
    assert np.allclose(bezier_points(control, np.array([0.0, 1.0])), control[[0, 3]])


def test_a_heading_error_swings_the_place_to_the_side() -> None:
    """Turned left by more than believed, it is left of where it believes to have driven."""
    before = np.diag([0.0, 0.0, 0.04])[None]
    east, north = (carried(before, np.array([way]))[0] for way in ((0.5, 0.0), (0.0, 0.5)))
    np.testing.assert_allclose(east, [[0, 0, 0], [0, 0.01, 0.02], [0, 0.02, 0.04]], atol=1e-12)
    np.testing.assert_allclose(north, [[0.01, 0, -0.02], [0, 0, 0], [-0.02, 0, 0.04]], atol=1e-12)
    unknown = carried(before, np.array([(np.nan, np.nan)]))
    np.testing.assert_array_equal(unknown, before)


@pytest.mark.parametrize("turned_deg", [0.0, 30.0, 90.0, 150.0])
def test_an_ellipse_lies_along_what_is_least_known(turned_deg: float) -> None:
    c, s = math.cos(math.radians(turned_deg)), math.sin(math.radians(turned_deg))
    axes = np.array([[c, -s], [s, c]])
    ((long_m, short_m, along_rad),) = ellipses_95((axes @ np.diag([0.09, 0.01]) @ axes.T)[None])
    assert (long_m, short_m) == pytest.approx((0.3 * 2.448, 0.1 * 2.448))
    assert math.cos(2.0 * (along_rad - math.radians(turned_deg))) == pytest.approx(1.0)


@pytest.mark.parametrize(("narrow", "deviations"), [(0.0, 1.960), (1.0, 2.448), (0.5, 2.046)])
def test_a_circle_of_certainty_is_between_a_lines_and_a_discs(
    narrow: float, deviations: float
) -> None:
    covariance = np.diag([0.09, 0.09 * narrow**2])[None]
    assert radius_95(covariance)[0] == pytest.approx(0.3 * deviations, rel=1e-3)


@given(poses, poses)
def test_steps_between_poses_lead_there_and_back(start: Pose, end: Pose) -> None:
    starts, ends = np.array([start]), np.array([end])
    step = between(starts, ends)
    assert -math.pi < step[0, 2] <= math.pi
    forth, back = compose(starts, step), uncompose(ends, step)
    for found, expected in ((forth, ends), (back, starts)):
        np.testing.assert_allclose(found[:, :2], expected[:, :2], atol=1e-9)
        assert -math.pi < found[0, 2] <= math.pi
        assert math.cos(found[0, 2] - expected[0, 2]) > 1.0 - 1e-9
