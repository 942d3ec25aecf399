"""Who sees what is on its lane stands before it, though nobody tells it of anybody."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from robot.contract import ImageSpec
from robot.errors import ConfigError, ContractError
from robot.navigation.road_map import load_map
from robot.vision.sight import OnnxSight
from sim_pybullet.randomise import load_look_sampler
from tests.trainer.judging.test_governed import Heedless
from trainer.judging.challenge import Episode, drive
from trainer.judging.cli import judge_command
from trainer.judging.drivers import Driver, Pilot
from trainer.judging.sighted import Sighted
from trainer.sight.cli import SHIPPED

POLICY: Any = SimpleNamespace(contract=SimpleNamespace(path_points=0, frames=1))


MEETS_A_DUCK = (70, 79, 84, 89, 94)  # seeds


def driven(driver: Driver) -> list[Episode]:
    where, looks = [load_map("rings/claw")], load_look_sampler("nominal")
    drives = drive(driver, "lfp", where, looks, MEETS_A_DUCK, 20.0, films=False)
    return [each for each, _ in drives]


def test_it_stands_before_the_ducks_that_a_heedless_driver_hits(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(Pilot, "choose", Heedless.choose)
    heedless, sighted = Heedless(), Sighted(POLICY, OnnxSight(SHIPPED))
    assert sighted.image == ImageSpec()
    assert {each.end for each in driven(heedless)} == {"collision_duck"}
    seen = driven(sighted)
    assert not [each for each in seen if each.end.startswith("collision")]
    assert np.median([each.tiles for each in seen]) > 5.0


def test_a_sight_that_tells_nothing_of_the_way_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(OnnxSight, "tells_way", False)
    with pytest.raises(ContractError, match="expected a sight that tells the free way"):
        Sighted(POLICY, OnnxSight(SHIPPED))


def test_at_junctions_sight_is_not_enough(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="does not tell who comes from the sides"):
        judge_command(str(tmp_path / "any.onnx"), "lfvi", poses="sight")
