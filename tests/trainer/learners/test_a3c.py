"""A3C: its arithmetic, that one worker repeats itself, and that workers may die."""

import multiprocessing
import os
from dataclasses import replace
from pathlib import Path
from typing import Any

import numba
import numpy as np
import torch
from stable_baselines3.common.callbacks import BaseCallback
from torch.nn.utils import parameters_to_vector

from tests.trainer.toy import ToyVecEnv, make_toy, toy_config, train_toy
from trainer.algorithms.a3c import A3C, A3cConfig
from trainer.config import RunConfig
from trainer.learners.a3c_worker import Orders, Shared, Worker, n_step_returns, shared_rmsprop
from trainer.presets import preset
from trainer.run import RunFolder
from trainer.training.checkpoint import TrainState, load_checkpoint, save_checkpoint


def a3c_config(steps: int, workers: int, seed: int = 0) -> RunConfig:
    config = toy_config("a3c", steps, seed)
    assert isinstance(config.learn, A3cConfig)
    return replace(config, learn=replace(config.learn, workers=workers))


def model_of(config: RunConfig) -> A3C:
    return A3C(config, make_toy, make_toy(config, 2, 0))


def test_the_papers_settings() -> None:
    learn = preset("track", "a3c", "paper").learn
    assert isinstance(learn, A3cConfig)
    assert (learn.workers, learn.robots) == (12, 1)
    assert (learn.learning_rate, learn.rms_decay, learn.rms_epsilon) == (0.01, 0.9, 0.1)
    assert len(preset("track", "a3c", "paper").net.channels) == 4


def test_returns_discount_and_stop_where_an_episode_ends() -> None:
    rewards = [torch.tensor([1.0, 1.0]), torch.tensor([2.0, 2.0]), torch.tensor([4.0, 4.0])]
    going_on = [torch.tensor([1.0, 1.0]), torch.tensor([1.0, 0.0]), torch.tensor([1.0, 1.0])]
    returns = n_step_returns(rewards, going_on, torch.tensor([8.0, 8.0]), 0.5)
    assert returns[:, 0].tolist() == [1 + 0.5 * (2 + 0.5 * (4 + 0.5 * 8)), 2 + 0.5 * 8, 8.0]
    assert returns[:, 1].tolist() == [1 + 0.5 * 2, 2.0, 8.0]


def test_rmsprop_is_torchs_with_epsilon_inside_the_root() -> None:
    generator = torch.Generator().manual_seed(0)
    weights, squares = torch.randn(6, generator=generator), torch.zeros(6)
    shared = Shared.of(weights, squares, 1)
    parameter = torch.nn.Parameter(weights.clone())
    ours = torch.optim.RMSprop([parameter], lr=0.01, alpha=0.9, eps=0.0)
    for _ in range(5):
        gradient = torch.randn(6, generator=generator)
        parameter.grad = gradient
        ours.step()
        shared_rmsprop(shared, gradient, 0.01, 0.9, 1e-16)
    torch.testing.assert_close(shared.weights, parameter.detach())


def add_one(shared: Shared, number: int) -> None:
    shared.weights.add_(1.0)
    shared.steps[number] = 7


def test_a_process_shares_memory_and_not_a_copy() -> None:
    shared = Shared.of(torch.arange(5.0), torch.zeros(5), 3)
    process = multiprocessing.get_context("forkserver").Process(target=add_one, args=(shared, 2))
    process.start()
    process.join()
    assert shared.weights.tolist() == [1.0, 2.0, 3.0, 4.0, 5.0]
    assert shared.squares.tolist() == [0.0] * 5
    assert shared.steps.tolist() == [0, 0, 7]
    assert not shared.leave


def test_a_cut_off_episode_is_worth_what_would_have_come() -> None:
    config = a3c_config(100, 1)
    weights = parameters_to_vector(model_of(config).policy.parameters()).detach()
    shared = Shared.of(weights, torch.zeros(1), 1)
    worker = Worker(Orders(config, make_toy, shared, 0, 0, 0))
    robots = config.learn.robots
    last = np.full((36, 36, 3), 128, np.uint8)
    infos: list[dict[str, Any]] = [{} for _ in range(robots)]
    infos[0] = {"TimeLimit.truncated": True, "terminal_observation": last}
    infos[1] = {"TimeLimit.truncated": False, "terminal_observation": last}
    done = np.array([True, True, *[False] * (robots - 2)])
    rewards = worker._with_future(np.ones(robots, np.float32), done, infos)
    worker.close()
    assert rewards[0] != 1.0
    assert (rewards[1:] == 1.0).all()


def test_one_worker_learns_the_toy_the_same_way_each_time(tmp_path: Path) -> None:
    def run(name: str, seed: int) -> list[tuple[int, float]]:
        train_toy(a3c_config(600, 1, seed), tmp_path / name)
        return [(e.step, e.reward) for e in RunFolder(tmp_path / name).episodes()]

    first, second, other = run("a", 1), run("b", 1), run("c", 2)
    assert first == second
    assert first != other
    metrics = train_toy(a3c_config(16_000, 1), tmp_path / "learned")
    assert metrics.success_rate >= 0.9


def test_a_checkpoint_keeps_the_shared_statistics(tmp_path: Path) -> None:
    config = a3c_config(600, 1)
    model = model_of(config)
    model.learn(600)
    save_checkpoint(tmp_path / "checkpoint.pt", model, TrainState())
    fresh = model_of(config)
    load_checkpoint(tmp_path / "checkpoint.pt", fresh)
    assert fresh.num_timesteps == model.num_timesteps >= 600
    assert torch.equal(fresh._squares(), model._squares())
    assert model._squares().abs().sum() > 0.0
    weights = fresh.policy.state_dict()
    assert all(torch.equal(v, weights[k]) for k, v in model.policy.state_dict().items())


def make_toy_and_tell(config: RunConfig, robots: int, seed: int) -> ToyVecEnv:
    """Notes how many threads numba makes in this process."""
    Path(os.environ["TOLD"], str(os.getpid())).write_text(str(numba.config.NUMBA_NUM_THREADS))
    return make_toy(config, robots, seed)


def learn_a_little(told: Path) -> None:
    os.environ |= {"TOLD": str(told), "NUMBA_NUM_THREADS": "2"}
    config = a3c_config(200, 2)
    A3C(config, make_toy_and_tell, make_toy(config, 2, 0)).learn(200)
    assert os.environ["NUMBA_NUM_THREADS"] == "2"


def test_each_worker_keeps_to_one_core(tmp_path: Path) -> None:
    """With a second thread each, a dozen on two cores were nineteen times slower."""
    process = multiprocessing.get_context("spawn").Process(target=learn_a_little, args=(tmp_path,))
    process.start()
    process.join()
    assert process.exitcode == 0
    assert [told.read_text() for told in tmp_path.iterdir()] == ["1", "1"]


class KillOneWorker(BaseCallback):
    """Kills a worker once it has worked, and stops when its place is filled again."""

    def __init__(self) -> None:
        super().__init__()
        self.killed = 0
        self.robots: set[int] = set()  # that ended an episode after the killing

    def _on_step(self) -> bool:
        ended = [episode.robot for episode in self.locals["episodes"]]
        if not self.killed and ended:
            worker = multiprocessing.active_children()[0]
            self.killed = worker.pid or 0
            worker.kill()
        elif self.model.replaced:
            self.robots.update(ended)
        return len(self.robots) < 2 * self.model._learn.robots


def test_a_killed_worker_is_replaced() -> None:
    model, callback = model_of(a3c_config(10**7, 2)), KillOneWorker()
    model.learn(10**7, callback)
    assert callback.killed
    assert model.replaced == 1
    assert model.workers_cpu_s > 0.0
    assert not multiprocessing.active_children()
    assert model.num_timesteps > 0
