from dataclasses import replace
from pathlib import Path

import pytest

from robot.errors import ConfigError
from sim_pybullet.tasks.spec import learned_tasks
from trainer.algorithms import NAMES
from trainer.algorithms.ppo import PpoConfig
from trainer.learners.policies import build_policy
from trainer.options import TrainOptions
from trainer.presets import preset
from trainer.run import RunFolder
from trainer.training.train import judged

PRESETS = ("paper", "fast", "debug")


@pytest.mark.parametrize("task", [spec.name for spec in learned_tasks()])
@pytest.mark.parametrize("name", PRESETS)
@pytest.mark.parametrize("algorithm", NAMES)
def test_every_preset_builds_and_survives_its_file(
    algorithm: str, name: str, task: str, tmp_path: Path
) -> None:
    config = replace(preset(task, algorithm, name), seed=3, seconds=2.5)
    if name != "paper":  # six million weights: once is enough, in test_networks
        build_policy(config)
    folder = RunFolder(tmp_path)
    folder.go_on(config)
    assert folder.load_config() == config


@pytest.mark.parametrize(
    ("arguments", "hint"),
    [
        (("lane", "dualing", "fast"), "'dueling'"),
        (("lane", "ppo", "papper"), "'paper'"),
        (("lain", "ppo", "fast"), "'lane'"),
    ],
)
def test_a_typo_is_told_the_nearest_name(arguments: tuple[str, str, str], hint: str) -> None:
    with pytest.raises(ConfigError, match=f"did you mean {hint}"):
        preset(*arguments)


def test_a_run_of_no_steps_is_refused() -> None:
    with pytest.raises(ConfigError, match="steps: expected 1 to"):
        replace(preset("lane", "ppo", "fast"), steps=0)


@pytest.mark.parametrize("commands", [-1, 3, 6])
def test_commands_that_no_robot_would_tell_are_refused(commands: int) -> None:
    with pytest.raises(ConfigError, match=f"commands: expected 0 or 5, got {commands}"):
        replace(preset("lane", "dagger", "fast"), commands=commands)


def test_a_rate_that_grows_is_refused() -> None:
    with pytest.raises(ConfigError, match="rate_left: expected"):
        replace(preset("lane", "ppo", "fast"), rate_left=1.5)


def test_the_auxiliary_task_of_an_actor_critic_needs_a_weight_of_the_entropy() -> None:
    config = preset("navigation", "ppo", "debug")
    greedy = replace(config.learn, entropy=0.0)
    with pytest.raises(ConfigError, match=r"expected learn\.entropy above 0"):
        replace(config, learn=greedy)
    assert replace(config, learn=greedy, true_path=0.0).learn == greedy


def test_who_cruises_looks_less_far_ahead_and_only_on_tracks() -> None:
    asked = TrainOptions("track", "ppo", style="cruise").config()
    race = preset("track", "ppo", "fast")
    assert asked.style == "cruise"
    assert isinstance(asked.learn, PpoConfig)
    assert isinstance(race.learn, PpoConfig)
    assert asked.learn.gamma < race.learn.gamma
    assert asked.relit
    assert asked.start_spread > race.start_spread == judged(asked).start_spread == 1.0
    for task, style in (("lane", "cruise"), ("track", "cruse")):
        with pytest.raises(ConfigError, match="cruise"):
            TrainOptions(task, "ppo", style=style).config()


def test_a_run_can_be_judged_less_often() -> None:
    config = TrainOptions("navigation", "ppo", steps=40_000, judgings=2).config()
    assert config.evaluation.every_share * config.steps == 20_000
    with pytest.raises(ConfigError, match="judgings: expected 1"):
        TrainOptions(judgings=0).config()


def test_both_lanes_are_asked_for_by_name_and_kept_in_the_file(tmp_path: Path) -> None:
    config = TrainOptions(lane="both", map=("rings/bean",)).config()
    RunFolder(tmp_path).go_on(config)
    assert RunFolder(tmp_path).load_config().lane == "both"
    with pytest.raises(ConfigError, match="did you mean 'both'"):
        TrainOptions(lane="bohth").config()
    for name, wrong, right in (
        ("start_spread", 0.5, "1.0 to 4.0"),
        ("true_path", -1.0, "0.0 to 100"),
    ):
        with pytest.raises(ConfigError, match=f"{name}: expected {right}"):
            TrainOptions(**{name: wrong}).config()  # type: ignore[arg-type]
