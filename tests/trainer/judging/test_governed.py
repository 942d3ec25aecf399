"""Under the rules of the road a driver who sees nobody hits nobody, and everybody gets on."""

from __future__ import annotations

from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from robot.contract import ACTION_WHEELS, MAX_WHEEL_MPS
from robot.navigation.road_map import load_map
from robot.vision.sight import OnnxSight
from sim_pybullet.batch import BatchWorld
from sim_pybullet.motors import expert_actions
from sim_pybullet.randomise import load_look_sampler
from trainer.judging.challenge import Episode, drive
from trainer.judging.drivers import Driver, Expert, Governed, Pilot, Together
from trainer.sight.cli import SHIPPED


class Heedless(Expert):
    """Keeps to the middle of its lane at full speed, whatever is there."""

    def choose(self, world: BatchWorld, seen: Any) -> np.ndarray:
        task = world.task
        return np.array(ACTION_WHEELS)[
            expert_actions(task.paths, world.poses, task.course.arc_m)
        ] / (MAX_WHEEL_MPS)


@pytest.fixture
def under_rules(monkeypatch: pytest.MonkeyPatch) -> Callable[..., Driver]:
    monkeypatch.setattr(Pilot, "choose", Heedless.choose)
    policy: Any = SimpleNamespace(contract=SimpleNamespace(path_points=0, commands=0, frames=1))

    def fresh(poses: str = "true") -> Driver:
        driver = Governed(policy, poses)
        driver.image = Heedless.image
        return driver

    return fresh


def driven(
    driver: Driver,
    challenge: str,
    where: str,
    episodes: int,
    seconds: float = 10.0,
    first: int = 70,
) -> list[Episode]:
    seeds, looks = range(first, first + episodes), load_look_sampler("nominal")
    drives = drive(driver, challenge, [load_map(where)], looks, seeds, seconds, films=False)
    return [each for each, _ in drives]


def test_eight_robots_on_a_town_pass_its_junctions_one_after_the_other(
    under_rules: Callable[..., Driver],
) -> None:
    told = driven(under_rules(), "lfvi", "town", 1)
    assert [each.end for each in told] == ["time"] * 8
    assert sum(each.lines_run for each in told) == 0
    assert min(each.tiles for each in told) > 0.2  # one may wait all the time
    assert sum(each.tiles for each in told) > 16.0
    assert sum(each.lines_run for each in driven(Heedless(), "lfvi", "town", 1)) > 0


def test_eight_robots_that_see_and_hear_each_other_need_no_localizer(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(Pilot, "choose", Heedless.choose)
    policy: Any = SimpleNamespace(contract=SimpleNamespace(path_points=10, commands=0, frames=1))
    told = driven(Together(policy, OnnxSight(SHIPPED)), "lfvi", "town", 1, 6.0)
    assert [each.end for each in told] == ["time"] * 8
    assert sum(each.lines_run for each in told) == 0
    assert sum(each.tiles for each in told) > 10.0


def test_by_poses_that_err_an_episode_is_the_same_whichever_others_are_driven(
    under_rules: Callable[..., Driver],
) -> None:
    two = driven(under_rules("arena"), "lfv", "loop", 2, 4.0)
    one = driven(under_rules("arena"), "lfv", "loop", 1, 4.0, first=71)
    assert two[1].figures == pytest.approx(one[0].figures, abs=1e-9)
    assert two[1].figures != pytest.approx(
        driven(under_rules(), "lfv", "loop", 1, 4.0, 71)[0].figures
    )


@pytest.mark.slow
def test_it_stands_before_ducks_and_behind_cars(under_rules: Callable[..., Driver]) -> None:
    for challenge in ("lfp", "lfv"):
        told = driven(under_rules(), challenge, "loop", 4)
        assert not any(each.at_fault for each in told)
        assert sum(each.tiles for each in told) > 8.0
    assert any(each.at_fault for each in driven(Heedless(), "lfv", "loop", 4))
