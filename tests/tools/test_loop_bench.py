"""Robot, localizer and monitor as processes on the bench, in lock-step: a mission, and faults."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
import pytest

from tools.faults.meet import every_case
from tools.faults.stage import Stage
from tools.loop.bench import BenchOptions
from tools.loop.missions import Driver
from tools.loop.pursuit import write_pursuit

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def stage(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Stage]:
    folder = tmp_path_factory.mktemp("bench")
    options = BenchOptions(write_pursuit(folder / "pursuit.onnx"), record=True)
    with Stage(options, folder) as stage:
        yield stage


def test_a_mission_from_the_page_to_the_wheels(stage: Stage) -> None:
    driver = Driver(stage.bench, np.random.default_rng(3))
    stage.ready()
    pose = stage.start
    ahead = (
        pose.x_m + 0.6 * math.cos(pose.heading_rad),
        pose.y_m + 0.6 * math.sin(pose.heading_rad),
    )
    record = driver.drive(ahead)
    assert record.arrived, record.reason
    assert record.seconds < 5.0
    assert max(record.offsets_m) < 0.05
    assert math.hypot(*record.errors[-1]) < 0.1, "the robot knows where it is"
    assert stage.bench.operator.picture.startswith(b"\xff\xd8")


FAULTS = [
    ("camera", "freezes"),
    ("I2C", "chip reset"),
    ("localizer", "killed"),
    ("network", "poses cut"),
    ("programs", "robot SIGKILL"),
]


@pytest.mark.parametrize(("family", "name"), FAULTS)
def test_a_fault_stops_the_robot_and_nothing_resumes(stage: Stage, family: str, name: str) -> None:
    (case,) = [case for of, case in every_case() if (of, case.name) == (family, name)]
    outcome = stage.play(family, case)
    assert outcome.passed, f"{outcome.problem}; shown: {outcome.state}: {outcome.reason}"
