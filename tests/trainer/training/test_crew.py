"""Several processes train one policy: alike for a seed, and whoever is killed is replaced."""

import os
import signal
import threading
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numba
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from rich.console import Console

from robot.errors import ConfigError
from tests import thorough
from tests.trainer.toy import make_toy, toy_config, train_toy
from trainer.algorithms import find_algorithm
from trainer.config import RunConfig
from trainer.envs import make_env
from trainer.options import TrainOptions, WorkerOptions
from trainer.presets import preset
from trainer.processes import Ended, LocalProcesses
from trainer.run import RunFolder
from trainer.sweeps.jobs import TrainJob
from trainer.training import crew
from trainer.training.crew import Crew, share_of
from trainer.training.peers import PeerLostError
from trainer.training.train import train


def two_processes(algorithm: str, steps: int, seed: int = 0) -> RunConfig:
    config = toy_config(algorithm, steps, seed)
    return replace(config, workers=2, evaluation=replace(config.evaluation, stop_after_perfect=0))


def weights(folder: Path) -> torch.Tensor:
    policy = torch.load(folder / "checkpoint.pt", weights_only=True)["policy"]
    return torch.cat([part.flatten().float() for part in policy.values()])


@given(st.integers(1, 64), st.integers(1, 512), st.integers(1, 64))
def test_processes_are_no_more_than_cores_and_each_has_enough_to_do(
    rollout: int, minibatch: int, cores: int
) -> None:
    learn: Any = preset("lane", "ppo", "fast").learn
    learn = replace(learn, rollout=rollout, minibatch=minibatch)
    shares = find_algorithm("ppo").shares
    assert shares is not None
    number = shares.good_number(learn, cores)
    assert 1 <= number <= cores
    assert rollout % number == minibatch % number == 0
    assert number == 1 or (rollout // number >= 16 and minibatch // number >= 32)
    if cores >= 2 and rollout % 32 == minibatch % 64 == 0:
        assert number > 1


@pytest.mark.parametrize("algorithm", ["ppo", "dueling", "ddqn", "dagger", "a2c"])
def test_several_processes_learn_as_often_from_as_much_as_one(algorithm: str) -> None:
    one = preset("navigation", algorithm, "fast")
    many = share_of(replace(one, workers=2), 0)
    assert decisions_per_update(many) * 2 == decisions_per_update(one)
    batch = "minibatch" if algorithm == "ppo" else "batch"
    if algorithm != "a2c":  # which learns from whole rollouts
        assert 2 * getattr(many.learn, batch) == getattr(one.learn, batch)
    assert many.learn.robots == (16 if algorithm == "a2c" else one.learn.robots)


def decisions_per_update(config: RunConfig) -> float:
    learn = config.learn
    steps = {"ppo": "rollout", "a2c": "a2c_rollout", "dagger": "dagger_every"}.get(config.algorithm)
    updates = getattr(learn, "gradient_steps", 1)
    return learn.robots * (getattr(learn, steps) if steps else 1) / updates


def test_shares_add_up_and_their_random_numbers_differ() -> None:
    config: Any = replace(preset("navigation", "ppo", "fast"), steps=1001, workers=4)
    shares: list[Any] = [share_of(config, rank) for rank in range(4)]
    assert {share.learn.robots for share in shares} == {config.learn.robots}
    assert {share.learn.minibatch for share in shares} == {config.learn.minibatch // 4}
    assert {share.learn.rollout for share in shares} == {config.learn.rollout // 4}
    assert sum(share.steps for share in shares) >= 1001
    assert len({share.seed for share in shares}) == 4
    assert share_of(replace(config, workers=1), 0) == replace(config, workers=1)


def test_each_paints_its_share_of_the_worlds() -> None:
    config = replace(preset("lane", "ppo", "fast"), look="randomised")
    painted = [
        len(make_env(replace(config, workers=workers), 2, 0).world._episodes.solids)
        for workers in (2, 16)
    ]
    assert painted == [24, 4]


@pytest.mark.parametrize(
    ("algorithm", "workers", "what"),
    [
        ("ppo", 0, "rollout 64, minibatch 256"),
        ("ppo", -2, "rollout 64, minibatch 256"),
        ("ppo", 3, "rollout 64, minibatch 256"),
        ("a2c", 5, "robots 32"),
        ("dueling", 6, "batch 128, buffer 40000, warm_up 500, epsilon_steps 10000"),
        ("a3c", 2, "1"),
    ],
)
def test_a_number_that_does_not_divide_the_work_is_refused(
    algorithm: str, workers: int, what: str
) -> None:
    with pytest.raises(ConfigError, match=f"workers: expected a number that divides {what}, got"):
        replace(preset("navigation", algorithm, "fast"), workers=workers)


@thorough.only
@pytest.mark.parametrize("algorithm", ["ppo", "dueling"])
def test_two_processes_learn_the_same_again(algorithm: str, tmp_path: Path) -> None:
    config = two_processes(algorithm, steps=2_200)
    runs = [tmp_path / name for name in ("one", "again")]
    first = train_toy(config, runs[0])
    assert train_toy(config, runs[1]).train_steps == first.train_steps >= 2_200
    torch.testing.assert_close(weights(runs[0]), weights(runs[1]), rtol=0, atol=0)
    robots = {episode.robot for episode in RunFolder(runs[0]).episodes()}
    assert robots == set(range(2 * config.learn.robots))  # those of the other process, too


@pytest.mark.slow
def test_two_processes_learn_what_one_does(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    threads: list[int] = []
    monkeypatch.setattr(numba, "set_num_threads", threads.append)
    metrics = train_toy(replace(toy_config("ppo", 40_000), workers=2), tmp_path / "run")
    assert threads == [1]  # the other core is the other process's
    assert metrics.success_rate == 1.0
    assert metrics.stopped_by == "solved"


class Killing(LocalProcesses):
    """Kills each of its first followers once they have learned a while."""

    def __init__(self, kills: int) -> None:
        super().__init__()
        self.kills = kills

    def start(self, do: Any, *orders: Any) -> Any:
        process = super().start(do, *orders)
        if self.kills:
            self.kills -= 1
            threading.Timer(2.5, os.kill, (process.pid, signal.SIGKILL)).start()
        return process


@pytest.mark.slow
def test_a_killed_follower_is_replaced_and_nothing_is_lost(tmp_path: Path) -> None:
    launcher, config = Killing(kills=1), two_processes("ppo", steps=12_000)
    metrics = train(config, RunFolder(tmp_path), make_toy, Console(quiet=True), launcher=launcher)
    assert launcher.kills == 0
    assert metrics.stopped_by == "steps"
    assert metrics.train_steps >= 12_000
    steps = [episode.step for episode in RunFolder(tmp_path).episodes()]
    assert steps == sorted(steps)


def test_a_run_goes_on_with_as_many_processes_as_it_was_begun_with(tmp_path: Path) -> None:
    folder = RunFolder(tmp_path / "run")
    folder.go_on(replace(preset("lane", "ppo", "debug"), workers=2))
    job = TrainJob(
        folder.path, TrainOptions(algo="ppo", preset="debug"), True, (), WorkerOptions(workers=4)
    )
    with pytest.raises(ConfigError, match="expected --workers 2, as the run was begun with, got 4"):
        job.run(Console(quiet=True))


class Nobody:
    """A launcher whose followers never get ready."""

    host, cores = "127.0.0.1", 2

    def __init__(self, status: int | None = None) -> None:
        self.ranks: list[int] = []
        self.status = status

    def start(self, do: Any, rank: int, *orders: Any) -> None:
        self.ranks.append(rank)

    def ended(self, process: Any) -> Ended | None:
        return None if self.status is None else Ended(self.status, "")

    def close(self) -> None: ...


def test_who_waits_for_followers_can_be_stopped(tmp_path: Path) -> None:
    launcher: Any = Nobody()
    crew = Crew(two_processes("ppo", 100), make_toy, tmp_path, launcher)
    asked: list[bool] = []

    def stopped() -> bool:
        asked.append(True)
        return len(asked) == 3

    model = SimpleNamespace(num_timesteps=0)  # has no learn: nobody may ask for it
    crew.learn(cast(Any, model), 100, None, stopped)
    assert launcher.ranks == [1]
    assert len(asked) == 3


def test_followers_that_die_again_and_again_are_an_error(tmp_path: Path) -> None:
    launcher: Any = Nobody(status=1)
    crew = Crew(two_processes("ppo", 100), make_toy, tmp_path, launcher)
    with pytest.raises(RuntimeError, match="followers that stay: exit status 1"):
        crew.learn(cast(Any, SimpleNamespace(num_timesteps=0)), 100, None, lambda: False)


def test_each_process_has_a_coach_of_its_own(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of one file the last to be written would be everybody's, so a seed would tell nothing."""
    asked: list[RunFolder] = []

    def build(making: Any) -> Any:
        asked.append(making.folder)
        raise PeerLostError

    algorithm = SimpleNamespace(build=build, shares=find_algorithm("coached").shares)
    monkeypatch.setattr(crew, "find_algorithm", lambda _: algorithm)
    monkeypatch.setattr(crew, "learning_world", lambda *_: SimpleNamespace(close=lambda: None))
    monkeypatch.setattr("signal.signal", lambda *_: None)
    config = replace(preset("lane", "coached", "debug"), workers=2)
    monkeypatch.chdir("/")
    crew.follow(1, ("", 0, b"", "no folder of this machine"), config, make_env, tmp_path)
    assert Path.cwd() == Path("/")
    crew.follow(1, ("", 0, b"", str(tmp_path)), config, make_env, tmp_path)
    assert Path.cwd() == tmp_path, "relative paths are the leader's"
    (own, _), leaders = asked, RunFolder(tmp_path)
    assert own.coach != leaders.coach
    assert own.replay != leaders.replay
    assert own.coach.parent == tmp_path, "it outlives its process"
