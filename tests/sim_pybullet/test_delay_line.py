"""Laws of the delay line."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from sim_pybullet.motors import DelayLine


@given(delays=st.lists(st.floats(0.0, 20.0), min_size=1, max_size=4))
def test_a_ramp_comes_out_as_much_later_as_its_delay(delays: list[float]) -> None:
    line = DelayLine(len(delays), 1)
    for i, delay in enumerate(delays):
        line.reset(i, delay, np.zeros(1))
    for k in range(1, 40):
        line.push(np.full((len(delays), 1), float(k)))
        np.testing.assert_allclose(line.read()[:, 0], np.maximum(k - np.array(delays), 0.0))


def test_a_reset_of_one_robot_leaves_the_others_alone() -> None:
    line = DelayLine(2, 1)
    line.reset(0, 3.0, np.zeros(1))
    for k in range(1, 8):
        line.push(np.full((2, 1), float(k)))
    line.reset(1, 9.5, np.full(1, -1.0))
    assert line.read().ravel().tolist() == [4.0, -1.0]
    line.push(np.full((2, 1), 8.0))
    assert line.read().ravel().tolist() == [5.0, -1.0]
