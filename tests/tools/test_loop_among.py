"""Two robots and a duck in one arena: programs as they are, which hear one localizer."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from robot.cli.install import SHIPPED_MODEL
from robot.inference.policy import SHIPPED_MODELS
from tests import thorough
from tests.tools.pursuit import write_pursuit
from tools.faults.meet import every_case
from tools.faults.stage import FROM, GOAL, START, Stage
from tools.loop.bench import Bench, BenchOptions
from tools.loop.missions import Driver

OF = BenchOptions(Path("none"), among=True)


@pytest.fixture(scope="module")
def stage(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Stage]:
    folder = tmp_path_factory.mktemp("among")
    with Stage(replace(OF, model=write_pursuit(folder / "pursuit.onnx")), folder) as stage:
        yield stage


@pytest.fixture(scope="module")
def keeper(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Stage]:
    """A lane keeper without map and localizer, which only sees, behind a navigator."""
    folder = tmp_path_factory.mktemp("by-sight")
    leader, sight = write_pursuit(folder / "pursuit.onnx"), SHIPPED_MODELS / "sight.onnx"
    options = replace(OF, model=SHIPPED_MODEL, map="loop", sight=sight, leader=leader)
    with Stage(options, folder) as stage:
        yield stage


@thorough.only
def test_without_a_localizer_they_tell_each_other_and_wait_while_one_is_silent(
    tmp_path: Path,
) -> None:
    pursuit, sight = write_pursuit(tmp_path / "pursuit.onnx"), SHIPPED_MODELS / "sight.onnx"
    options = replace(OF, model=pursuit, localizer=False, sight=sight)
    with Bench(options, tmp_path / "bench") as bench:
        town, driver = bench.town, Driver(bench, np.random.default_rng(0))
        assert town.second is not None
        for page, robot, pose in (
            (bench.operator, town, START),
            (bench.second, town.second, driver.on_lane(*FROM[:2])),
        ):
            robot.world.place(pose)
            page.ask("disarm")
            page.ask("place", pose.moved(1.0, 0.0)[:2], start=pose[:2])
        driver.rest()
        assert driver.drive((0.56, 1.452)).arrived  # over one junction
        bench.stop("robot2")
        for kind, place in (("arm", None), ("mission", GOAL)):
            assert bench.operator.ask(kind, place) == (True, "")
        waits = "AUTO: nothing tells who is at the junction"
        bench.until(lambda: waits in bench.processes["robot"].said(), 20.0, "it to wait")
        bench.until(lambda: bench.now_s - town.moved_s > 5.0, 20.0, "it to stand for long")


def met(stage: Stage, family: str, name: str) -> float:
    """How far apart the two robots are at the end [m]."""
    (case,) = [case for case in every_case() if (case.family, case.name) == (family, name)]
    outcome = stage.play(case)
    assert not outcome.problem, f"{outcome.problem}; shown: {outcome.state}: {outcome.reason}"
    assert stage.bench.town.second is not None
    return math.dist(stage.bench.town.pose[:2], stage.bench.town.second.pose[:2])


@pytest.mark.parametrize(
    "name", ["other's link dies", "duck", "other stops"][: thorough.count(1, 3)]
)
def test_it_stands_before_who_stands_on_its_lane(stage: Stage, name: str) -> None:
    assert met(stage, "traffic", name) > 0.18


@thorough.only
@pytest.mark.parametrize("name", ["other stops", "duck"])
def test_a_lane_keeper_stands_before_what_it_sees_and_says_so(keeper: Stage, name: str) -> None:
    assert met(keeper, "by sight", name) > 0.18
    assert "AUTO: something is" in keeper.bench.processes["robot"].said()
