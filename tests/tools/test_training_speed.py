import pytest

from tests.tools.training_speed import training_speed


def test_a_training_tells_where_its_time_goes() -> None:
    speed = training_speed("lane", "ppo", "nominal", "debug")
    assert 5.0 < speed.decisions_per_cpu_s < 1e6
    assert 0.0 < speed.world_share < 1.0
    assert speed.world_share + speed.learner_share == pytest.approx(1.0)
