"""The policies in ``robot/models`` drive, are small enough, and say where they come from."""

from pathlib import Path

import numpy as np
import pytest

from robot.contract import ImageSpec
from robot.inference.policy import OnnxPolicy
from robot.inference.preprocess import preprocess_batch
from robot.navigation.road_map import load_map
from sim_pybullet.batch import BatchWorld
from sim_pybullet.randomise import load_look_sampler
from sim_pybullet.tasks.navigation import Navigation
from tests.thorough import count

MODELS = Path(__file__).parents[3] / "robot" / "models"
NAVIGATORS = sorted(path.stem for path in MODELS.glob("nav_*.onnx"))
IN_BOTH = [name for name in NAVIGATORS if f"{name}_int8" in NAVIGATORS]
LARGEST_BYTES = 8_000_000
ROBOTS = count(2, 10)


@pytest.mark.parametrize("path", sorted(MODELS.glob("*.onnx")), ids=lambda path: path.stem)
def test_it_is_small_and_has_a_card(path: Path) -> None:
    card = MODELS / f"{path.stem.removesuffix('_int8')}.md"
    assert path.stat().st_size <= LARGEST_BYTES
    assert path.name in card.read_text(encoding="utf-8")
    assert "python -m trainer train" in card.read_text(encoding="utf-8")


def test_every_navigator_is_there_in_both_precisions() -> None:
    assert sorted([*IN_BOTH, *(f"{name}_int8" for name in IN_BOTH)]) == NAVIGATORS


@pytest.mark.parametrize("name", IN_BOTH)
def test_it_arrives_in_a_town_it_never_saw_with_drifting_poses(name: str) -> None:
    """Every other robot drives by the network in INT8."""
    policies = [OnnxPolicy(MODELS / f"{name}{ending}.onnx") for ending in ("", "_int8")]
    looks = load_look_sampler("randomised", "arena")
    world = BatchWorld(Navigation([load_map("town")], ROBOTS), looks, ImageSpec(), 3, 4)
    observation, driving, arrived = world.reset(), np.ones(ROBOTS, dtype=bool), 0
    while driving.any():
        chosen, paths = np.zeros(ROBOTS, dtype=int), observation.path
        assert paths is not None
        for k, policy in enumerate(policies):
            pictures = preprocess_batch(observation.image[k::2], policy.contract.image)
            chosen[k::2] = policy.values(pictures, paths[k::2]).argmax(axis=1)
        step = world.step(chosen)
        ended = driving & (step.task.terminated | step.task.truncated)
        arrived += int((ended & step.task.success).sum())
        driving &= ~ended
        observation = step.observation
    world.close()
    assert arrived >= ROBOTS - count(0, 1)
