"""What a run says of its world reaches that world."""

from dataclasses import replace
from unittest.mock import Mock

import numpy as np
import pytest

from sim_pybullet.look import ARENA_POSE, NOMINAL
from sim_pybullet.rendering.ray_camera import NoCamera
from sim_pybullet.tasks.lane_keeping import LaneKeeping
from trainer import envs
from trainer.presets import preset


@pytest.mark.parametrize(("workers", "pool_size"), [(1, 24), (2, 12), (16, 4)])
def test_the_world_of_a_run_is_as_its_configuration_says(
    workers: int, pool_size: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Each process has the seed that it is given, and paints its share, four worlds at least."""
    made = Mock()
    monkeypatch.setattr(envs, "BatchWorld", made)
    monkeypatch.setattr(envs, "DuckpilotVecEnv", lambda world: world)
    config = replace(
        preset("lane", "ppo", "fast"),
        seed=9,
        maps=("loop", "rings/bean"),
        look="randomised",
        without=("drive", "ground.wear"),
        pose_error="arena",
        lane="both",
        start_spread=3.0,
        workers=workers,
    )
    envs.make_env(config, 4, 5, NoCamera())
    (task, looks, image, seed, size, camera, translator), _ = made.call_args
    assert (image, seed, size, translator) == (config.image, 5, pool_size, None)
    assert isinstance(camera, NoCamera)
    assert isinstance(task, LaneKeeping)
    assert (task.n_robots, [place.name for place in task.road_maps]) == (4, ["loop", "bean"])
    assert task._spread == 3.0
    assert [len(ways) for ways in task._ways] == [2, 2]
    look = looks(np.random.default_rng(0))
    assert (look.drive, look.pose, look.ground.wear) == (NOMINAL.drive, ARENA_POSE, 0.0)
    assert look.ground.brightness != NOMINAL.ground.brightness
