import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from localizer_node.kalman import FloorFilter, HeadingFilter
from tests.localizer_node.rigs import turn

DT_S = 1.0 / 30.0


@given(st.floats(-0.4, 0.4), st.floats(-0.4, 0.4))
def test_a_steady_velocity_is_found(vx, vy):
    floor = FloorFilter(np.zeros(2), 0.004)
    for step in range(1, 60):
        floor.predict(DT_S)
        floor.update(np.array([vx, vy]) * step * DT_S, 0.004)
    assert np.allclose(floor.velocity_mps, (vx, vy), atol=2e-3)


def test_filtering_beats_measuring():
    rng = np.random.default_rng(0)
    floor, errors, noises = FloorFilter(np.zeros(2), 0.004), [], []
    for step in range(1, 400):
        place = np.array([0.3 * step * DT_S, 0.0])
        noise = rng.normal(0.0, 0.004, 2)
        floor.predict(DT_S)
        floor.update(place + noise, 0.004)
        errors.append(np.sum((floor.position_m - place) ** 2))
        noises.append(np.sum(noise**2))
    assert np.mean(errors) < 0.8 * np.mean(noises)


def test_the_lag_of_the_velocity_is_what_it_says():
    """On a circle the filtered velocity points where the robot headed ``lag_s`` ago."""
    floor, radius, rate = FloorFilter(np.array([0.3, 0.0]), 0.004), 0.3, 1.0
    for step in range(1, 200):
        angle = rate * step * DT_S
        floor.predict(DT_S)
        floor.update(radius * np.array([math.cos(angle), math.sin(angle)]), 0.004)
    course = math.atan2(floor.velocity_mps[1], floor.velocity_mps[0])
    late = turn(course, angle + math.pi / 2.0)
    assert late == pytest.approx(rate * floor.lag_s, rel=0.1)


def test_uncertainty_grows_unseen_and_shrinks_when_seen():
    floor = FloorFilter(np.zeros(2), 0.004)
    for _ in range(30):
        floor.predict(DT_S)
        floor.update(np.zeros(2), 0.004)
    steady = floor.covariance[0, 0]
    near = floor.distance(np.array([0.1, 0.0]), 0.004)
    for _ in range(10):
        floor.predict(DT_S)
    assert floor.covariance[0, 0] > steady
    assert floor.distance(np.array([0.1, 0.0]), 0.004) < near


@given(st.floats(-3.1, 3.1), st.floats(-2.4, 2.4))
def test_a_turn_is_followed_across_the_seam_at_pi(start, rate):
    heading = HeadingFilter(start, 0.02)
    for step in range(1, 90):
        heading.predict(DT_S)
        heading.update(start + rate * step * DT_S, 0.02)
    assert turn(heading.heading_rad, start + rate * 89 * DT_S) < 0.01
    assert heading.turn_radps == pytest.approx(rate, abs=0.05)
    assert -math.pi < heading.heading_rad <= math.pi


@given(st.floats(-3.1, 3.1), st.floats(-1.4, 1.4), st.booleans())
def test_an_axis_is_taken_the_nearer_way_round(start, error, other_way):
    heading = HeadingFilter(start, 0.1)
    heading.update_axis(start + error + (math.pi if other_way else 0.0), 0.1)
    assert turn(heading.heading_rad, start + error / 2.0) < 1e-6
