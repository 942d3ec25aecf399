"""Each algorithm learns a toy world in seconds, the same way each time."""

import time
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import gymnasium
import numpy as np
import pytest
import torch
from rich.console import Console
from stable_baselines3.common.env_checker import check_env

from tests.thorough import THOROUGH, count
from tests.trainer.toy import (
    EPISODE_STEPS,
    BrightColumn,
    ToyVecEnv,
    build_model,
    make_toy,
    toy_config,
    train_toy,
)
from trainer.algorithms.ddqn import DoubleDQN
from trainer.config import RunConfig
from trainer.envs import SeenOtherwise
from trainer.learners.actor_critic import ActorCriticConfig, entropies
from trainer.learners.networks import GreedyNetwork
from trainer.learners.policies import build_policy, falling
from trainer.run import RunFolder
from trainer.training.checkpoint import TrainState, load_policy, read_state, save_checkpoint
from trainer.training.train import train
from trainer.training.watch import drive_greedily

STEPS = {"ddqn": 4_000, "dueling": 4_000, "dagger": 3_000, "ppo": 8_000, "a2c": 16_000}


@pytest.mark.filterwarnings("ignore:It seems that your observation")
def test_toy_is_a_proper_environment() -> None:
    check_env(BrightColumn())


@pytest.mark.parametrize("algorithm", STEPS)
def test_learns_the_toy(algorithm: str, tmp_path: Path) -> None:
    metrics = train_toy(toy_config(algorithm, STEPS[algorithm]), tmp_path)
    assert metrics.success_rate >= 0.9
    assert metrics.train_steps <= STEPS[algorithm] + 256


@pytest.mark.parametrize("algorithm", ["dueling", "ppo"][: count(1, 2)])
def test_learns_from_the_path_when_the_picture_is_empty(algorithm: str, tmp_path: Path) -> None:
    def make_navigator(config: RunConfig, robots: int, seed: int) -> ToyVecEnv:
        def one() -> gymnasium.Env:
            return BrightColumn(with_path=True)

        env = ToyVecEnv([one] * robots)
        env.seed(seed)
        return env

    config = toy_config(algorithm, 3_000)
    folder = RunFolder(tmp_path)
    env = make_navigator(config, config.learn.robots, 0)
    model = build_model(config, env, folder.replay)
    model.learn(3_000 if algorithm == "dueling" else 6_000)
    env.seed(99)
    observation, rewards = env.reset(), []
    for _ in range(32):
        actions = GreedyNetwork(model.policy).actions(observation)
        observation, reward, _, _ = env.step(actions)
        rewards.append(reward)
    assert np.mean(rewards) >= 0.9


@pytest.mark.parametrize("algorithm", STEPS if THOROUGH else ["dueling", "ppo"])
def test_two_runs_with_one_seed_are_one_run(algorithm: str, tmp_path: Path) -> None:
    def run(name: str, seed: int) -> tuple[list[tuple[int, float]], dict[str, torch.Tensor]]:
        folder = tmp_path / name
        train_toy(toy_config(algorithm, 400, seed), folder)
        policy = build_policy(toy_config(algorithm, 400, seed))
        load_policy(folder / "best.pt", policy)
        episodes = [(e.step, e.reward) for e in RunFolder(folder).episodes()]
        return episodes, policy.state_dict()

    (first, weights), (second, same), (other, _) = run("a", 1), run("b", 1), run("c", 2)
    assert first == second
    assert first != other
    assert all(torch.equal(weights[name], same[name]) for name in weights)


@pytest.mark.parametrize("algorithm", STEPS)
def test_a_checkpoint_brings_back_what_went_in(algorithm: str, tmp_path: Path) -> None:
    config = toy_config(algorithm, 600)
    model = build_model(config, make_toy(config, config.learn.robots, 0), tmp_path / "a")
    model.learn(600)
    save_checkpoint(tmp_path / "checkpoint.pt", model, TrainState(seconds=12.5))
    fresh = build_model(config, make_toy(config, config.learn.robots, 0), tmp_path / "b")
    state = read_state(tmp_path / "checkpoint.pt", fresh)
    assert state == TrainState(seconds=12.5)
    assert fresh.num_timesteps == model.num_timesteps
    weights = fresh.policy.state_dict()
    assert all(torch.equal(v, weights[k]) for k, v in model.policy.state_dict().items())
    assert _flat(model.policy.optimizer.state_dict()) == _flat(fresh.policy.optimizer.state_dict())


def _flat(state: dict) -> list[float]:
    moments = [value for entry in state["state"].values() for value in entry.values()]
    return [float(torch.as_tensor(value).sum()) for value in moments]


@pytest.mark.parametrize("gap", [0.0, 0.8])
def test_double_target_takes_the_choice_of_one_and_the_value_of_the_other(
    gap: float, tmp_path: Path
) -> None:
    config = toy_config("ddqn", 1_000)
    config = replace(config, learn=replace(config.learn, action_gap=gap))
    model = build_model(config, make_toy(config, 8, 0), tmp_path)
    assert isinstance(model, DoubleDQN)
    model.learn(300)  # past the warm-up: both networks differ
    batch = model.replay_buffer.sample(64)  # type: ignore[union-attr]
    with torch.no_grad():
        following, target = (
            net(batch.next_observations).numpy() for net in (model.q_net, model.q_net_target)
        )
        values = model.q_net(batch.observations).numpy()
        before = model.q_net_target(batch.observations).numpy()
    rows = np.arange(64)
    double = target[rows, following.argmax(1)]
    going_on = ((1 - batch.dones) * batch.discounts)[:, 0].numpy()
    wanted = batch.rewards[:, 0].numpy() + going_on * double
    wanted -= gap * (before.max(1) - before[rows, batch.actions[:, 0]])
    error = values[rows, batch.actions[:, 0]] - wanted
    huber = np.where(np.abs(error) < 1, 0.5 * error**2, np.abs(error) - 0.5).mean()
    model.replay_buffer.sample = lambda _: batch  # type: ignore[union-attr, method-assign]
    assert model._update(64) == pytest.approx(float(huber), rel=1e-5)


def test_the_learning_rate_falls_to_what_shall_be_left(tmp_path: Path) -> None:
    config = replace(toy_config("ppo", 2_000), rate_left=0.1)
    endless = replace(config.evaluation, stop_after_perfect=0)
    model = build_model(
        replace(config, evaluation=endless), make_toy(config, 8, 0), tmp_path / "replay"
    )
    model.learn(2_000)
    rate = model.policy.optimizer.param_groups[0]["lr"]
    assert 0.1 - 1e-9 <= rate / config.learn.learning_rate < 0.25
    assert falling(config.learn.learning_rate, config.rate_left)(1.0) == config.learn.learning_rate


@pytest.mark.parametrize("algorithm", ["ppo", "a2c"][: count(1, 2)])
def test_chance_is_paid_for_less_and_less_and_not_at_all_in_the_end(
    algorithm: str, tmp_path: Path
) -> None:
    config = replace(toy_config(algorithm, 2_000), entropy_left=0.0)
    weights = [entropies(config)(left) for left in (1.0, 0.7, 0.4, 0.1, 0.0, -0.01)]
    assert isinstance(config.learn, ActorCriticConfig)
    assert weights[0] == config.learn.entropy
    assert weights[1] == pytest.approx(0.5 * config.learn.entropy)
    assert weights[2:] == pytest.approx([0.0] * 4)
    model = build_model(config, make_toy(config, 8, 0), tmp_path / "replay")
    model.learn(2_000)
    assert model.ent_coef == pytest.approx(0.0)  # type: ignore[attr-defined]


def test_cpu_seconds_are_kept_over_a_resumption(tmp_path: Path) -> None:
    first = train_toy(toy_config("ppo", 600), tmp_path)
    second = train_toy(toy_config("ppo", 1_200), tmp_path)
    assert 0.0 < first.cpu_seconds < second.cpu_seconds


def test_a_time_budget_ends_a_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    now = [0.0]

    def clock() -> float:
        now[0] += 0.01
        return now[0]

    told = SimpleNamespace(monotonic=clock, process_time=time.process_time)
    monkeypatch.setattr("trainer.training.watch.time", told)
    config = replace(toy_config("ppo", 10**6), seconds=5.0)
    metrics = train(config, RunFolder(tmp_path), make_toy, Console(quiet=True))
    assert metrics.stopped_by in ("seconds", "solved")
    assert metrics.train_seconds < 6.0


def test_the_last_evaluation_is_part_of_the_time_of_training(tmp_path: Path) -> None:
    metrics = train_toy(toy_config("ppo", 600), tmp_path)
    assert metrics.evaluations[-1].step == metrics.train_steps
    assert metrics.evaluations[-1].seconds <= metrics.train_seconds
    assert metrics.evaluations[-1].cpu_seconds <= metrics.cpu_seconds


def test_the_record_has_the_whole_reward_and_the_learner_its_share(tmp_path: Path) -> None:
    config = replace(toy_config("dagger", 600), reward_scale=0.25)
    train_toy(config, tmp_path)
    assert {e.reward for e in RunFolder(tmp_path).episodes()} <= set(map(float, range(17)))
    scaled = SeenOtherwise(make_toy(config, 8, 0), lambda seen, _: seen, reward_scale=0.25)
    scaled.reset()
    rewards = np.concatenate([scaled.step(np.zeros(8, dtype=int))[1] for _ in range(10)])
    assert set(rewards.tolist()) == {0.0, 0.25}


def test_rounds_are_the_first_episodes_of_each_robot(tmp_path: Path) -> None:
    config = toy_config("ppo", 256)
    network = GreedyNetwork(build_model(config, make_toy(config, 8, 0), tmp_path).policy)
    once, thrice = (
        drive_greedily(network.actions, make_toy(config, 4, 0), seed=5, rounds=rounds)
        for rounds in (1, 3)
    )
    assert thrice.rewards.shape == (3, 4)
    assert np.all(thrice.steps == EPISODE_STEPS)
    for first, all_of_them in zip(once, thrice, strict=True):
        np.testing.assert_array_equal(all_of_them[:1], first)
