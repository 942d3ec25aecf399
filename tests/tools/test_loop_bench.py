"""Robot, localizer and monitor as processes on the bench, in lock-step: a mission, and faults."""

from __future__ import annotations

import math
from collections.abc import Iterator
from itertools import groupby, pairwise
from pathlib import Path

import numpy as np
import pytest

from robot.recording.reader import entries, read_turns
from robot.recording.topics import OVERHEAD
from tests import thorough
from tests.thorough import count
from tests.tools.pursuit import write_pursuit
from tools.faults.meet import every_case
from tools.faults.stage import Stage
from tools.loop.__main__ import main
from tools.loop.bench import BenchOptions
from tools.loop.missions import Driver
from tools.loop.timekeeper import BenchError

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
    ("programs", "page not watched"),
    ("localizer", "killed"),
    ("programs", "robot SIGKILL"),
    ("camera", "freezes"),
    ("I2C", "chip reset"),
    ("network", "poses cut"),
]


def test_who_waits_in_vain_is_told_what_the_programs_said(stage: Stage) -> None:
    with pytest.raises(BenchError, match=r"expected a miracle.*'localizer'.*DISARMED"):
        stage.bench.until(lambda: False, 0.1, "a miracle")


DRIVERS = [("person", "0.132,0.7"), ("expert", "0.132,1.2")]


@pytest.mark.parametrize(("family", "name"), FAULTS[: count(3, 6)])
def test_a_fault_stops_the_robot_and_nothing_resumes(stage: Stage, family: str, name: str) -> None:
    (case,) = [case for case in every_case() if (case.family, case.name) == (family, name)]
    outcome = stage.play(case)
    assert not outcome.problem, f"{outcome.problem}; shown: {outcome.state}: {outcome.reason}"


@thorough.only
@pytest.mark.parametrize(("driver", "goal"), DRIVERS)
def test_whoever_drives_the_recording_tells_it(driver: str, goal: str, tmp_path: Path) -> None:
    model = write_pursuit(tmp_path / "drifts.onnx", drift_per_m=6.0)
    words = ["--driver", driver, "--model", str(model), "--record", str(tmp_path / "drives")]
    assert main([*words, "--start", "0.132,2.156", "--goal", goal]) == 0
    (drive,) = (tmp_path / "drives").iterdir()
    turns = [turn for turn, frame in read_turns(drive) if frame is not None]
    states = [state for state, _ in groupby(turn.state for turn in turns)]
    if driver == "expert":
        assert states == ["READY", "MANUAL", "DISARMED"]
    else:
        assert states.count("MANUAL") >= 2, "this policy strays"
        assert all(a == "AUTO" for a, b in pairwise(states) if b == "MANUAL"), "a person took over"
    steered = {turn.driven.wanted for turn in turns if turn.state == "MANUAL" and turn.driven}
    assert len(steered) > 10, "more than five actions"
    assert sum(1 for _ in entries(drive, OVERHEAD)) > 50
