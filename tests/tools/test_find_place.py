"""A robot without a localizer: told nothing, or roughly, it drives on until it is sure.

Then it drives a mission; all by the robot's own runtime over virtual hardware.
"""

from __future__ import annotations

import pytest

from robot.inference.policy import SHIPPED_MODELS
from robot.navigation.road_map import load_map
from sim_pybullet.look import NOMINAL
from tests.tools.find_place import Lonely, drive

NAVIGATOR = str(SHIPPED_MODELS / "nav_ppo.onnx")


@pytest.mark.parametrize("click", [False, True], ids=["told nothing", "told roughly"])
def test_it_drives_on_until_it_knows_its_place_and_then_to_its_destination(click: bool) -> None:
    found = drive(Lonely(load_map("arena"), NOMINAL, NAVIGATOR, seed=0), click, missions=1)
    assert found.right, found
    assert found.sure, found
    assert found.arrived == 1, found
    assert not found.strayed
