"""The figures of an evaluation, by hand."""

from types import SimpleNamespace
from typing import Any

import pytest

from sim_pybullet.batch import DriveMetrics
from trainer.judging.evaluate import Drive, summarise
from trainer.judging.intervals import share
from trainer.options import EvaluateOptions

DRIVES = [
    Drive(7, True, DriveMetrics(10.0, 30.0, 0.6, 0.0, 0.02), failed=False, laps=2.0),
    Drive(8, False, DriveMetrics(2.0, 8.0, 0.4, 0.5, 0.05), failed=True, laps=0.5, collided=True),
    Drive(9, False, DriveMetrics(6.0, 40.0, 0.2, 0.1, 0.005), failed=True, laps=1.0),
    Drive(10, True, DriveMetrics(12.0, 42.0, 1.2, 0.2, 0.03), failed=False, laps=2.5),
]
POLICY: Any = SimpleNamespace(contract=SimpleNamespace(algorithm="ppo", run="abc"))


def test_the_figures_of_four_drives() -> None:
    inputs = EvaluateOptions("m.onnx", "lane", ("loop",), episodes=4, seed=7)
    found = summarise(inputs, POLICY, DRIVES)
    assert (found.episodes, found.success_rate, found.failures) == (4, 0.5, (8, 9))
    assert (found.collisions, found.failed_ends) == (1, 2)
    assert found.mean_path_distance_m == pytest.approx(2.4 / 120.0)
    assert found.survival_time_s == pytest.approx(30.0)
    assert found.driven_lane_m == pytest.approx(7.5)
    assert found.outside_lane_s == pytest.approx(0.2)
    assert found.laps == pytest.approx(1.5)
    assert found.mean_speed_mps == pytest.approx(30.0 / 120.0)
    assert (found.algorithm, found.run, found.schema) == ("ppo", "abc", 1)
    assert found.success_rate_low == pytest.approx(0.1500, abs=1e-4)  # of 2 in 4, from a table


def test_a_race_cars_speed_is_that_on_the_real_track() -> None:
    inputs = EvaluateOptions("m.onnx", "track", ("forest",), episodes=4, seed=7)
    without = [drive._replace(laps=None) for drive in DRIVES]
    found = summarise(inputs, POLICY, without)
    assert found.laps is None
    assert found.mean_speed_mps == pytest.approx(20.0 * 30.0 / 120.0)


@pytest.mark.parametrize(
    ("successes", "episodes", "low"), [(15, 20, 0.5313), (98, 100, 0.9300), (1, 2, 0.0945)]
)
def test_wilsons_interval(successes: int, episodes: int, low: float) -> None:
    assert share(successes, episodes).low == pytest.approx(low, abs=1e-4)
