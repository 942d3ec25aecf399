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
LARGEST_BYTES = 8_000_000
ROBOTS = count(4, 10)


@pytest.mark.parametrize("path", sorted(MODELS.glob("*.onnx")), ids=lambda path: path.stem)
def test_it_is_small_and_has_a_card(path: Path) -> None:
    card = MODELS / f"{path.stem.removesuffix('_int8')}.md"
    assert path.stat().st_size <= LARGEST_BYTES
    assert path.name in card.read_text(encoding="utf-8")
    assert "python -m trainer train" in card.read_text(encoding="utf-8")


@pytest.mark.parametrize("name", NAVIGATORS)
def test_it_arrives_in_a_town_it_never_saw_with_drifting_poses(name: str) -> None:
    policy = OnnxPolicy(MODELS / f"{name}.onnx")
    looks = load_look_sampler("randomised", "arena")
    world = BatchWorld(Navigation([load_map("town")], ROBOTS), looks, ImageSpec(), 3, 4)
    observation, driving, arrived = world.reset(), np.ones(ROBOTS, dtype=bool), 0
    while driving.any():
        pictures = preprocess_batch(observation.image, policy.contract.image)
        step = world.step(policy.values(pictures, observation.path).argmax(axis=1))
        ended = driving & (step.task.terminated | step.task.truncated)
        arrived += int((ended & step.task.success).sum())
        driving &= ~ended
        observation = step.observation
    world.close()
    assert arrived >= ROBOTS - 1
