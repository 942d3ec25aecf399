"""A robot without a localizer: told nothing, or roughly, it drives on until it is sure.

Then it drives a mission; all by the robot's own runtime over virtual hardware.
"""

from __future__ import annotations

import pytest

from robot.errors import PlanError
from robot.inference.policy import SHIPPED_MODELS
from robot.navigation.road_map import load_map
from sim_pybullet.look import NOMINAL
from tests import thorough
from tests.tools.find_place import Lonely, drive

NAVIGATOR = str(SHIPPED_MODELS / "nav_ppo.onnx")


@pytest.mark.parametrize("click", [False, True][: thorough.count(1, 2)])
def test_it_drives_on_until_it_knows_its_place_and_then_to_its_destination(click: bool) -> None:
    found = drive(Lonely(load_map("arena"), NOMINAL, NAVIGATOR, seed=0), click, missions=1)
    assert found.right, found
    assert found.sure, found
    assert found.arrived == 1, found
    assert not found.strayed


@thorough.only
@pytest.mark.parametrize("name", ["bean", "wedge"])
def test_a_lap_of_a_ring_without_junctions_is_enough(name: str) -> None:
    ring = load_map(f"rings/{name}")
    found = drive(Lonely(ring, NOMINAL, NAVIGATOR, seed=0), click=False, missions=1)
    assert found.right, found
    assert found.sure, found
    assert found.driven_m < 9.0, "a lap"
    assert found.arrived == 1, found


@thorough.only
def test_of_a_ring_that_is_the_same_turned_half_round_it_says_that_two_places_fit() -> None:
    robot = Lonely(load_map("rings/zigzag"), NOMINAL, NAVIGATOR, seed=0)
    found = drive(robot, click=False, missions=0)
    assert found.right is None, found
    assert not found.strayed
    with pytest.raises(PlanError, match="2 places fit what it saw, not surely enough yet; say on"):
        robot.navigator.plan((1.0, 1.0))
