import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from localizer_node.track import RateFilter
from tests.localizer_node.rigs import turn

DT_S = 1.0 / 30.0


def on_the_floor():
    return RateFilter(np.zeros(2), 0.004, 0.3, 2.0)


@given(st.floats(-0.4, 0.4), st.floats(-0.4, 0.4))
def test_a_steady_velocity_is_found(vx, vy):
    floor = on_the_floor()
    for step in range(1, 60):
        floor.predict(DT_S)
        floor.update(np.array([vx, vy]) * step * DT_S, 0.004)
    assert np.allclose(floor.rate, (vx, vy), atol=2e-3)


def test_filtering_beats_measuring():
    rng = np.random.default_rng(0)
    floor, errors, noises = on_the_floor(), [], []
    for step in range(1, 400):
        place = np.array([0.3 * step * DT_S, 0.0])
        noise = rng.normal(0.0, 0.004, 2)
        floor.predict(DT_S)
        floor.update(place + noise, 0.004)
        errors.append(np.sum((floor.value - place) ** 2))
        noises.append(np.sum(noise**2))
    assert np.mean(errors) < 0.8 * np.mean(noises)


def test_uncertainty_grows_unseen_and_shrinks_when_seen():
    floor = on_the_floor()
    for _ in range(30):
        floor.predict(DT_S)
        floor.update(np.zeros(2), 0.004)
    steady = floor.covariance[0, 0]
    for _ in range(10):
        floor.predict(DT_S)
    assert floor.covariance[0, 0] > steady


@given(st.floats(-3.1, 3.1), st.floats(-2.4, 2.4))
def test_a_turn_is_followed_across_the_seam_at_pi(start, rate):
    heading = RateFilter(np.array([start]), 0.02, 2.0, 40.0, is_angle=True)
    for step in range(1, 90):
        heading.predict(DT_S)
        heading.update(np.array([start + rate * step * DT_S]), 0.02)
    assert turn(float(heading.value[0]), start + rate * 89 * DT_S) < 0.01
    assert heading.rate[0] == pytest.approx(rate, abs=0.05)
    assert -math.pi < heading.value[0] <= math.pi
