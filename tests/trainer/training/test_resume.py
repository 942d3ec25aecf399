"""A run that dies goes on; a run that is asked to stop leaves everything in order."""

import signal
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest
import torch
from rich.console import Console

from robot.errors import ConfigError
from tests.thorough import count
from tests.trainer.toy import QUICK, build_model, make_toy, toy_config, train_toy
from trainer.run import RunFolder
from trainer.training import watch
from trainer.training.checkpoint import (
    TrainState,
    content_of,
    put_back,
    read_state,
    save_checkpoint,
)
from trainer.training.train import train
from trainer.training.watch import Watch

ROOT = Path(__file__).parents[3]
ENDLESS = 10_000_000


def start(algorithm: str, folder: Path) -> subprocess.Popen:
    command = [sys.executable, "-m", "tests.trainer.toy", algorithm, str(folder), str(ENDLESS)]
    return subprocess.Popen(command, cwd=ROOT)


def wait_for(condition: Callable[[], bool], process: subprocess.Popen) -> None:
    deadline = time.monotonic() + 120.0
    while not condition():
        assert process.poll() is None, "the run ended by itself"
        assert time.monotonic() < deadline, "no checkpoint within two minutes"
        time.sleep(0.05)


def checkpoint_step(folder: Path) -> int:
    content = torch.load(folder / "checkpoint.pt", weights_only=True)
    return int(content["counters"]["num_timesteps"])


def episode_is_kept(run: RunFolder) -> bool:
    """Whether a checkpoint lies there that was written after the end of an episode."""
    ended = [episode.step for episode in run.episodes()] if run.checkpoint.exists() else []
    return bool(ended) and checkpoint_step(run.path) >= ended[0]


@pytest.mark.parametrize("algorithm", ["dueling", "ppo"][: count(1, 2)])
def test_killed_run_goes_on_where_its_checkpoint_lies(algorithm: str, tmp_path: Path) -> None:
    run = RunFolder(tmp_path / "run")
    process = start(algorithm, run.path)
    try:
        wait_for(lambda: episode_is_kept(run), process)
    finally:
        process.kill()
        process.wait()
    step = checkpoint_step(run.path)
    assert step > 0
    config = replace(run.load_config(), steps=step + 400)
    metrics = train_toy(config, run.path)
    assert step + 400 <= metrics.train_steps <= step + 1_000
    steps = [episode.step for episode in run.episodes()]
    assert steps == sorted(steps)
    assert len(steps) == metrics.episodes
    assert any(s <= step for s in steps)
    assert any(s > step for s in steps)
    assert run.onnx.exists()
    assert run.curve.exists()


@pytest.mark.parametrize("algorithm", ["dueling", "a3c"][: count(1, 2)])
def test_ctrl_c_leaves_a_run_that_can_go_on(algorithm: str, tmp_path: Path) -> None:
    run = RunFolder(tmp_path / "run")
    process = start(algorithm, run.path)
    try:
        wait_for(lambda: len(run.episodes()) > 0, process)
        process.send_signal(signal.SIGINT)
        assert process.wait(timeout=30.0) == 0
    finally:
        process.kill()
        process.wait()
    assert checkpoint_step(run.path) > 0
    assert not run.metrics.exists(), "an interrupted run is not a finished one"
    assert run.replay.exists() == (algorithm == "dueling")
    assert not list(run.path.glob(".*")), "a temporary file was left"


def test_finished_run_has_nothing_left_to_do(tmp_path: Path) -> None:
    config = toy_config("ppo", 600)
    first = train_toy(config, tmp_path)
    again = train_toy(config, tmp_path)
    assert again.train_steps == first.train_steps
    assert again.evaluations == first.evaluations


def test_a_damaged_checkpoint_is_told_with_what_to_do(tmp_path: Path) -> None:
    config = toy_config("ppo", 600)
    train_toy(config, tmp_path)
    run = RunFolder(tmp_path)
    whole = run.checkpoint.read_bytes()
    for size in (0, 1000, len(whole) - 10):
        run.checkpoint.write_bytes(whole[:size])
        with pytest.raises(ConfigError, match=r"checkpoint\.pt: .*damaged.*or delete it"):
            train_toy(replace(config, steps=1200), tmp_path)


@pytest.mark.parametrize("algorithm", ["dueling", "dagger"])
def test_a_finished_run_that_goes_on_fills_its_memory_before_it_learns(
    algorithm: str, tmp_path: Path
) -> None:
    config = toy_config(algorithm, 600)
    train_toy(config, tmp_path)
    run = RunFolder(tmp_path)

    def updates() -> int:
        return int(torch.load(run.checkpoint, weights_only=True)["counters"]["_n_updates"])

    done, warm_up = updates(), QUICK[algorithm]["warm_up"]
    train_toy(replace(config, steps=600 + warm_up - 8), tmp_path)
    assert updates() == done > 0
    train_toy(replace(config, steps=600 + 5 * warm_up), tmp_path)
    assert updates() > done


def test_those_who_learn_together_fill_their_memories_for_as_long(tmp_path: Path) -> None:
    config = toy_config("dueling", 600)
    folders = tmp_path / "leads", tmp_path / "follows"
    made = [build_model(config, make_toy(config, 8, 0), folder) for folder in folders]
    for steps in (600, 1200):  # else one takes the other's gradients for something else
        made[0].num_timesteps = steps
        save_checkpoint(tmp_path / "checkpoint.pt", made[0], TrainState())
        made[0].learning_starts = 200
        read_state(tmp_path / "checkpoint.pt", made[0])
        put_back(made[1], content_of(made[0]))
        assert [each.learning_starts for each in made] == [steps + 200] * 2


def test_a_run_that_goes_on_for_longer_says_so(tmp_path: Path) -> None:
    config = toy_config("ppo", 600)
    train_toy(config, tmp_path)
    longer = replace(config, steps=1200)
    train_toy(longer, tmp_path)
    assert RunFolder(tmp_path).load_config() == longer
    with pytest.raises(ConfigError, match="another seed"):
        train_toy(replace(longer, seed=5), tmp_path)


def test_a_policy_that_is_kept_is_told_of_at_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Else a kill leaves its weights under the figures of the one before."""
    told: list[str] = []
    evaluate, save = Watch.evaluate, Watch.save

    def evaluates(one: Watch) -> None:
        evaluate(one)
        told.append("best" if one.state.best is one.state.evaluations[-1] else "worse")

    def saves(one: Watch) -> None:
        told.append("saved")
        save(one)

    monkeypatch.setattr(Watch, "evaluate", evaluates)
    monkeypatch.setattr(Watch, "save", saves)
    monkeypatch.setattr(watch, "CHECKPOINT_PERIOD_S", 1e6)
    config = toy_config("dueling", 1_200)
    often = replace(config.evaluation, every_steps=200, every_share=0.0, stop_after_perfect=0)
    folder = RunFolder(tmp_path / "run")
    train(replace(config, evaluation=often), folder, make_toy, Console(quiet=True))
    after = {told[k + 1] for k, what in enumerate(told[:-1]) if what == "best"}
    assert after == {"saved"}
