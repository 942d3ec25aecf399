"""The way check doubts no honest drive (`robot.navigation.way_check`)."""

from __future__ import annotations

import pytest

from tests import thorough
from tests.sim_pybullet.honest_drives import doubts


@pytest.mark.parametrize("look", ["reality", "randomised"][: thorough.count(1, 2)])
def test_no_honest_mission_is_doubted(look: str) -> None:
    told = doubts(look, 16, ("town", "arena"), seed=3)
    assert told.missions == 16
    assert told.driven_s > 200.0
    assert (told.doubted, told.at_bound) == (0, 0)
    assert 0.1 < told.coarse_max < 0.9
    assert told.fine_max < 0.9
