"""Two robots and a duck in one arena: programs as they are, which hear one localizer."""

from __future__ import annotations

import math
from collections.abc import Iterator

import pytest

from robot.safety.governors import Rules
from tests.tools.pursuit import write_pursuit
from tools.faults.stage import Stage
from tools.faults.traffic import TRAFFIC
from tools.loop.bench import BenchOptions


@pytest.fixture(scope="module")
def stage(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Stage]:
    folder = tmp_path_factory.mktemp("among")
    model = write_pursuit(folder / "pursuit.onnx")
    with Stage(BenchOptions(model, among=True, rules=Rules(headway=True)), folder) as stage:
        yield stage


@pytest.mark.parametrize(
    "name",
    [
        "duck",
        *(pytest.param(n, marks=pytest.mark.slow) for n in ("other stops", "other's link dies")),
    ],
)
def test_it_stands_before_who_stands_on_its_lane(stage: Stage, name: str) -> None:
    (case,) = [case for case in TRAFFIC if case.name == name]
    outcome = stage.play("traffic", case)
    assert outcome.passed, f"{outcome.problem}; shown: {outcome.state}: {outcome.reason}"
    assert stage.bench.town.second is not None
    assert math.dist(stage.bench.town.pose[:2], stage.bench.town.second.pose[:2]) > 0.18
