"""Coaches: told the true path, taught by reward, and imitated."""

from dataclasses import replace
from pathlib import Path
from typing import cast

import numpy as np
import pytest
from rich.console import Console
from stable_baselines3.common.policies import ActorCriticPolicy

from robot.contract import PATH_POINTS
from robot.inference.policy import OnnxPolicy
from robot.navigation.path import path_inputs
from sim_pybullet.rendering.ray_camera import NoCamera
from sim_pybullet.tasks.spec import find_task
from sim_pybullet.vec_env import DuckpilotVecEnv
from tests.sim_pybullet.racing.actions import RacingAction
from tests.thorough import count
from tests.trainer.toy import build_model
from trainer.algorithms.dagger import Dagger
from trainer.cli import main
from trainer.config import RunConfig
from trainer.envs import make_env
from trainer.learners.coach import find_coach, told, told_instead
from trainer.options import TrainOptions
from trainer.run import RunFolder

QUIET = Console(quiet=True)


def make_blind_env(config: RunConfig, robots: int, seed: int) -> DuckpilotVecEnv:
    return make_env(config, robots, seed, NoCamera())


def run(task: str = "track", **options: str) -> RunConfig:
    maps = ("karting",) if task == "track" else ("loop",)
    return TrainOptions(task, "coached", "debug", map=maps, **options).config()


def test_a_coach_is_told_the_true_path_and_the_speed() -> None:
    env = make_blind_env(run(style="cruise"), 5, 0)
    world, wrapped = env.world, told_instead(env)
    known = wrapped.reset()
    ended = 0
    for _ in range(80):
        assert wrapped.observation_space.contains(known[0])
        task = world.task
        true = path_inputs(task.paths, world.poses, task.course.arc_m)
        np.testing.assert_array_equal(known[:, :PATH_POINTS], true)
        speeds_mps = task.vehicle.counted[:, 0]
        np.testing.assert_allclose(known[:, PATH_POINTS], speeds_mps / 0.5, rtol=1e-6)
        known, _, done, infos = wrapped.step(np.full(5, RacingAction.LEFT))
        for i in np.flatnonzero(done):
            assert wrapped.observation_space.contains(infos[i]["terminal_observation"])
            ended += 1
    assert ended
    wrapped.close()


def test_a_coach_of_lane_keepers_is_told_their_last_commands_as_they_are() -> None:
    env = make_blind_env(run("lane"), 2, 0)
    wrapped = told_instead(env)
    wrapped.reset()
    for action in (0, 4, 2, 1, 3):
        known = wrapped.step(np.full(2, action))[0]
    assert wrapped.observation_space.contains(known[0])
    assert known.shape == (2, PATH_POINTS + 1 + 10)
    wheels = (0.0576, 0.3024, 0.3024, 0.0576, 0.3, 0.3, 0.2541, 0.3459, 0.3459, 0.2541)
    np.testing.assert_allclose(known[:, PATH_POINTS + 1 :], [np.array(wheels) / 0.3459] * 2, 1e-5)
    wrapped.close()


def drives(coach: ActorCriticPolicy | None, config: RunConfig) -> float:
    """Mean reward of a decision, by a coach or by lot."""
    env, rng = make_blind_env(config, 16, 7), np.random.default_rng(0)
    env.reset()
    rewards = []
    for _ in range(150):
        chosen = rng.integers(9, size=16)
        if coach is not None:
            chosen, _ = coach.predict(told(env.world), deterministic=True)
        rewards.append(env.step(chosen)[1].mean())
    env.close()
    return float(np.mean(rewards))


def test_is_taught_by_reward_once_and_then_found(tmp_path: Path) -> None:
    config = run(style="cruise")
    coach = find_coach(tmp_path / "coach.pt", config, 25_000, QUIET)
    assert drives(coach, config) > 2.0 * max(drives(None, config), 0.005)
    again = find_coach(tmp_path / "coach.pt", config, 0, QUIET)  # not taught again
    world = make_blind_env(config, 16, 3).world
    world.reset()
    np.testing.assert_array_equal(
        *(each.predict(told(world), deterministic=True)[0] for each in (again, coach))
    )
    world.close()


class AlwaysRight:
    """Whatever it is told."""

    def predict(self, known: np.ndarray, deterministic: bool) -> tuple[np.ndarray, None]:
        assert deterministic
        return np.full(len(known), int(RacingAction.RIGHT)), None


def test_what_the_coach_says_is_what_is_learned(tmp_path: Path) -> None:
    config = run()
    env = make_env(config, config.learn.robots, 0)
    model = build_model(config, env, tmp_path / "replay")
    assert isinstance(model, Dagger)
    model.coach = cast(ActorCriticPolicy, AlwaysRight())
    model.learn(1_500)
    assert model.replay_buffer is not None
    stored = model.replay_buffer.actions[:100]
    assert (stored == int(RacingAction.RIGHT)).all()
    image = np.asarray(env.reset())
    assert (model.predict(image, deterministic=True)[0] == int(RacingAction.RIGHT)).all()
    env.close()


@pytest.mark.parametrize("task", ["lane", "track"][: count(1, 2)])
def test_a_run_keeps_its_coach(task: str, tmp_path: Path) -> None:
    out = tmp_path / "run"
    words = ["train", "--task", task, "--algo", "coached", "--preset", "debug", "--out", str(out)]
    words += ["--map", "karting" if task == "track" else "loop"]
    assert main([*words, "--steps", "96"]) == 0
    coach = RunFolder(out).coach
    before = coach.read_bytes()
    assert main([*words, "--steps", "160", "--resume"]) == 0
    assert coach.read_bytes() == before
    assert RunFolder(out).load_config() == replace(RunFolder(out).load_config(), steps=160)
    actions = find_task(task).actions
    policy = OnnxPolicy(RunFolder(out).onnx, None if task == "lane" else actions)
    assert policy.contract.commands == (5 if task == "lane" else 0)
