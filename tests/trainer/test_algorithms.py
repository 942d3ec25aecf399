"""An algorithm is one file: what the rest of the trainer knows of it, it looks up by name."""

import re
import sys
from dataclasses import dataclass, replace
from pathlib import Path
from types import SimpleNamespace

import pytest
import yaml

from robot.errors import ConfigError
from robot.typed_config import to_plain
from tests.trainer.toy import toy_config, train_toy
from trainer import algorithms
from trainer.algorithms import NAMES, Algorithm
from trainer.algorithms.ppo import PpoConfig, build
from trainer.learners.networks import DrivingActorCritic
from trainer.presets import preset
from trainer.run import RunFolder

TRAINER = Path(algorithms.__file__).parents[1]
# What a training wrote before algorithms had files of their own.
DAGGER = """
task: lane
algorithm: dagger
preset: fast
learn: {robots: 16, learning_rate: 0.0005, batch: 128, dagger_every: 4, gradient_steps: 2,
  buffer: 40000, warm_up: 500, expert_steps: 2000, random_share: 0.08, coach_steps: 0,
  max_grad_norm: 10.0}
maps: [loop]
seed: 3
steps: 2000
seconds: null
reward_scale: 0.05
image: {width_px: 80, height_px: 60, crop_top_px: 20}
net: {channels: [16, 32, 32], image_fc: 256, path_fc: [64, 128], head_fc: 128, centred: false}
evaluation: {episodes: 20, rounds: 1, every_steps: 2000, every_share: 0.0, stop_after_perfect: 2,
  maps: [], look: ''}
look: nominal
without: []
pose_error: null
translate: null
lane: outer
style: race
start_spread: 1.0
relit: false
true_path: 0.0
rate_left: 1.0
entropy_left: 1.0
device: cpu
threads: 1
"""


def test_the_learner_is_asked_for_by_name_alone() -> None:
    learners = re.compile(r"isinstance\([\w.]*learn\b|\b(Q|Ppo|A2c|A3c|Dagger)Config\b")
    elsewhere = [path for path in TRAINER.rglob("*.py") if path.parent.name != "algorithms"]
    assert not [path.name for path in elsewhere if learners.search(path.read_text())]


def test_a_run_of_before_is_read(tmp_path: Path) -> None:
    (tmp_path / "config.yaml").write_text(DAGGER)
    found = RunFolder(tmp_path).load_config()
    assert found == replace(preset("lane", "dagger", "fast"), seed=3, steps=2_000)
    then = yaml.safe_load(DAGGER)  # with one worker, without a backbone, and told no commands
    then["learn"]["untold_share"] = 0.6
    then["net"]["backbone"] = ""
    assert to_plain(found) == {**then, "workers": 1, "commands": 0}


@pytest.mark.parametrize(
    ("before", "after", "said"),
    [
        ("algorithm: dagger", "algorithm: daggre", "did you mean 'dagger'"),
        ("task: lane", "task: lain", "did you mean 'lane'"),
        ("dagger_every: 4", "dagger_evry: 4", "did you mean 'dagger_every'"),
        ("algorithm: dagger", "algorithm: [dagger]", "expected the configuration of a training"),
    ],
)
def test_a_wrong_configuration_is_one_line_with_the_nearest_name(
    before: str, after: str, said: str, tmp_path: Path
) -> None:
    (tmp_path / "config.yaml").write_text(DAGGER.replace(before, after))
    with pytest.raises(ConfigError, match=said):
        RunFolder(tmp_path).load_config()


@dataclass(frozen=True)
class WaryConfig(PpoConfig):
    """PPO with a setting of its own."""

    wariness: float = 0.5


def test_an_algorithm_of_ones_own_trains_and_is_kept_with_its_settings(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    presets = {"debug": {"learn": {"robots": 2}}, "track": {"steps": 77}}
    wary = Algorithm("Wary PPO", WaryConfig(), DrivingActorCritic, build, presets)
    monkeypatch.setattr(algorithms, "NAMES", (*NAMES, "wary"))  # as if its file lay there
    monkeypatch.setitem(sys.modules, "trainer.algorithms.wary", SimpleNamespace(ALGORITHM=wary))
    assert preset("lane", "wary", "debug").learn.robots == 2
    assert preset("track", "wary", "fast").steps == 77
    learn = WaryConfig(robots=8, rollout=32, minibatch=64, wariness=0.25)
    train_toy(replace(toy_config("ppo", 300), algorithm="wary", learn=learn), tmp_path)
    assert RunFolder(tmp_path).load_config().learn == learn
    assert RunFolder(tmp_path).onnx.exists()
