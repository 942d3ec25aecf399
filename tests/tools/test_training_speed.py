from pathlib import Path

import pytest

from tests.bench import training_figures
from tests.tools import training_speed as measuring
from tests.tools.training_speed import TrainingSpeed, training_speed


def test_a_training_tells_where_its_time_goes() -> None:
    speed = training_speed("lane", "ppo", "nominal", "debug")
    assert 5.0 < speed.decisions_per_cpu_s < 1e6
    assert 0.0 < speed.world_share < 1.0
    assert speed.world_share + speed.learner_share == pytest.approx(1.0)


def test_the_bench_measures_both_trainings_in_both_looks(monkeypatch: pytest.MonkeyPatch) -> None:
    def in_checkout(case: str, checkout: Path) -> TrainingSpeed:
        assert (checkout / "trainer" / "__main__.py").is_file()
        return TrainingSpeed(float(len(case)), 0.25, 0.75)

    monkeypatch.setattr(measuring, "in_checkout", in_checkout)
    cases = ("lane_dueling_nominal", "lane_dueling_randomised")
    cases += ("navigation_ppo_nominal", "navigation_ppo_randomised")
    assert training_figures() == {
        case: {"decisions_per_cpu_s": len(case), "world_share": 0.25, "learner_share": 0.75}
        for case in cases
    }
