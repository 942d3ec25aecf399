"""Who sees what is on its lane stands before it, though nobody tells it of anybody."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from robot.contract import CONTROL_DT_S, MAX_WHEEL_MPS, ImageSpec, PolicyContract
from robot.errors import ConfigError
from robot.inference.policy import SHIPPED_MODELS
from robot.inference.preprocess import FRAME_SHAPE
from robot.navigation.road_map import load_map
from robot.safety.state_machine import Command
from robot.vision.sight import OnnxSight
from sim_pybullet.batch import Observation
from sim_pybullet.randomise import load_look_sampler
from tests.robot.navigation.test_lane_watch import FakeSight, OnTheLane
from tests.robot.navigation.test_way_seen import picture
from tests.trainer.judging.test_governed import Heedless
from trainer.judging.challenge import Contest, Episode, drive
from trainer.judging.cli import JudgeOptions, judge_command
from trainer.judging.drivers import Driver, Pilot, Sighted, Together
from trainer.sight.cli import SHIPPED

POLICY: Any = SimpleNamespace(contract=SimpleNamespace(path_points=0, commands=0, frames=1))


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


def test_who_is_told_its_last_commands_is_told_them_among_others_too() -> None:
    asked: list[np.ndarray] = []

    class Told:
        contract = PolicyContract("lane", "coached", commands=5)

        def values(self, _pictures: np.ndarray, path: np.ndarray) -> np.ndarray:
            asked.append(path[0])
            return np.eye(5)[[4]]

    where, looks = [load_map("rings/claw")], load_look_sampler("nominal")
    list(drive(Pilot(Told()), "lfp", where, looks, MEETS_A_DUCK[:1], 0.3, films=False))
    right = [0.3024 / 0.3459, 0.0576 / 0.3459]
    for k, told in enumerate(asked[:3]):
        np.testing.assert_allclose(told, [0.0] * (10 - 2 * k) + right * k, atol=1e-4)
    assert len(asked) == 3


def test_the_judge_decides_as_the_robot_does(monkeypatch: pytest.MonkeyPatch) -> None:
    """The same pictures, in which things come and go, and the same wheels in every turn."""
    rng, turns = np.random.default_rng(0), 400
    there = np.repeat(rng.random(turns // 8) < 0.5, 8)
    script = [
        picture(float(t), f) for t, f in zip(there, rng.uniform(0.05, 0.5, turns), strict=True)
    ]
    robot = OnTheLane()
    robot.bench.turn()
    for command in (Command.ARM, Command.AUTO):
        assert robot.bench.runtime.ask(command).accepted
    robot.sight.sees = iter(script).__next__
    drove = []
    for _ in range(turns):
        drove.append(robot.turn().bench.motors.wheels)
    assert len(set(drove)) > 50
    assert (0.0, 0.0) in drove
    monkeypatch.setattr(Pilot, "choose", lambda *_: np.full((1, 2), 0.3 / MAX_WHEEL_MPS))
    judged = Sighted(POLICY, FakeSight(iter(script).__next__))  # type: ignore[arg-type]
    world: Any = SimpleNamespace(active=np.ones(1, bool), poses=np.zeros((1, 3)))
    for wheels in drove:
        seen = Observation(rng.integers(0, 255, (1, *FRAME_SHAPE), np.uint8), None)
        told_mps = MAX_WHEEL_MPS * judged.choose(world, seen)[0]
        assert told_mps == pytest.approx(wheels, abs=1e-9)
        world.poses[0, 0] += CONTROL_DT_S * told_mps[0]


def test_at_junctions_sight_is_not_enough_for_a_lane_keeper() -> None:
    keeper, navigator = (str(SHIPPED_MODELS / f"{name}.onnx") for name in ("lane_ppo", "nav_ppo"))
    asked = JudgeOptions(keeper, "lfvi", poses="sight")
    with pytest.raises(ConfigError, match="expected a navigator, to know its junctions by sight"):
        judge_command(asked)
    assert isinstance(Contest(navigator, asked, films=False).driver(), Together)
