"""A3C: what it shares, that one worker repeats itself, and that workers may die."""

import multiprocessing
import os
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numba
import numpy as np
import pytest
import torch
from stable_baselines3.common.callbacks import BaseCallback
from torch.nn.utils import parameters_to_vector

from tests import thorough
from tests.trainer.toy import ToyVecEnv, build_model, make_toy, toy_config, train_toy
from trainer.algorithms.a3c import A3C, A3cConfig, Shared, SharedRmsprop
from trainer.config import RunConfig
from trainer.presets import preset
from trainer.processes import Ended
from trainer.run import RunFolder
from trainer.training.checkpoint import TrainState, read_state, save_checkpoint
from trainer.training.peers import PeerLostError


def a3c_config(steps: int, seed: int = 0, **learn: Any) -> RunConfig:
    config = toy_config("a3c", steps, seed)
    return replace(config, learn=replace(config.learn, **{"workers": 1, **learn}))


def model_of(config: RunConfig) -> A3C:
    model = build_model(config, make_toy(config, config.learn.robots, 0), Path())
    assert isinstance(model, A3C)
    return model


def rolled(**learn: Any) -> A3C:
    """One worker that has driven for a rollout, and not learned from it."""
    model = model_of(a3c_config(10_000, **learn))
    model.learn(0)
    rollout = (model.env, model._init_callback(None), model.rollout_buffer, model.n_steps)
    model.collect_rollouts(*rollout)
    return model


def test_the_papers_settings() -> None:
    learn = preset("track", "a3c", "paper").learn
    assert isinstance(learn, A3cConfig)
    assert (learn.workers, learn.robots) == (12, 1)
    assert (learn.learning_rate, learn.rms_decay, learn.rms_epsilon) == (0.01, 0.9, 0.1)
    assert len(preset("track", "a3c", "paper").net.channels) == 4


def test_a_rollout_is_worth_what_it_earned_and_what_would_have_come() -> None:
    """The toy cuts episodes off after 16 decisions; what comes then begins anew."""
    model = rolled(a3c_rollout=20)
    buffer, picture = model.rollout_buffer, model._last_obs
    with torch.no_grad():
        value = model.policy.predict_values(torch.from_numpy(np.array(picture))).flatten().numpy()
    for t in reversed(range(20)):
        ends = t == 15
        value = buffer.rewards[t] + (0.0 if ends else model.gamma) * value
        np.testing.assert_allclose(buffer.returns[t], value, rtol=1e-4)
    plain = np.delete(buffer.rewards, 15, axis=0)
    assert set(np.unique(plain)) <= {0.0, 1.0}
    assert not np.isin(buffer.rewards[15], (0.0, 1.0)).any()  # with the value of the last picture


def test_rmsprop_is_torchs_with_epsilon_inside_the_root() -> None:
    generator = torch.Generator().manual_seed(0)
    weights = torch.randn(6, generator=generator)
    parameter, other = (torch.nn.Parameter(weights.clone()) for _ in range(2))
    theirs = torch.optim.RMSprop([parameter], lr=0.01, alpha=0.9, eps=0.0)
    ours = SharedRmsprop([other], 0.01, 0.9, 1e-16, 1)
    for _ in range(5):
        gradient = torch.randn(6, generator=generator)
        for each, optimiser in ((parameter, theirs), (other, ours)):
            each.grad = gradient.clone()
            optimiser.step()
    torch.testing.assert_close(ours.shared.weights, parameter.detach())
    assert torch.equal(other.detach(), ours.shared.weights)


def test_shared_statistics_keep_their_share_of_the_past() -> None:
    parameter = torch.nn.Parameter(torch.tensor([1.0]))
    optimiser = SharedRmsprop([parameter], 0.5, 0.75, 5.0, 1)
    optimiser.load_state_dict({"squares": torch.tensor([4.0])})
    parameter.grad = torch.tensor([2.0])
    optimiser.step()
    assert optimiser.state_dict()["squares"].tolist() == [0.75 * 4.0 + 0.25 * 4.0]
    assert parameter.item() == pytest.approx(1.0 - 0.5 * 2.0 / 3.0)


def test_weights_that_are_frozen_as_those_of_a_backbone_stay_out() -> None:
    """They have no gradient; ``--backbone`` ended in a traceback at the first update."""
    frozen = torch.nn.Parameter(torch.ones(3), requires_grad=False)
    free = torch.nn.Parameter(torch.ones(2))
    optimiser = SharedRmsprop([frozen, free], 0.1, 0.9, 0.1, 1)
    free.grad = torch.ones(2)
    optimiser.step()
    assert len(optimiser.shared.weights) == 2
    assert (free < 1.0).all()
    assert (frozen == 1.0).all()


def test_workers_that_have_driven_all_steps_leave_in_peace() -> None:
    """While the first is in its last rollout; it then ended without metrics and a policy."""
    model = object.__new__(A3C)
    ends = {0: None, 1: Ended(0, ""), 2: Ended(1, "")}
    pipe, _ = multiprocessing.Pipe(duplex=False)
    model._processes = SimpleNamespace(ended=ends.get)  # type: ignore[assignment]
    model._cpu_s = [0.0, 0.0]
    model._workers = [(0, pipe), (1, pipe)]  # type: ignore[list-item]
    assert model.news() == [([], 0.0)] * 2
    model._workers = [(0, pipe), (2, pipe)]  # type: ignore[list-item]
    with pytest.raises(RuntimeError, match="worker 3 left: its error is above"):
        model.news()


def add_one(shared: Shared, number: int) -> None:
    shared.weights.add_(1.0)
    shared.steps[number] = 7


def test_a_process_shares_memory_and_not_a_copy() -> None:
    parameter = torch.nn.Parameter(torch.arange(5.0))
    optimiser = SharedRmsprop([parameter], 0.1, 0.9, 0.1, 3)
    shared = optimiser.shared
    process = multiprocessing.get_context("forkserver").Process(target=add_one, args=(shared, 2))
    process.start()
    process.join()
    assert shared.weights.tolist() == [1.0, 2.0, 3.0, 4.0, 5.0]
    assert shared.squares.tolist() == [0.0] * 5
    assert shared.steps.tolist() == [0, 0, 7]
    assert parameter.tolist() == [0.0, 1.0, 2.0, 3.0, 4.0]
    optimiser.pull()
    assert parameter.tolist() == shared.weights.tolist()


@pytest.mark.parametrize("limit", [1e-3, 1e-2])
def test_a_step_goes_no_farther_than_its_gradient_may(limit: float) -> None:
    model = rolled(max_grad_norm=limit)
    model.rollout_buffer.returns[:] = 9.0
    model.train()
    gradient = parameters_to_vector([p.grad for p in model.policy.parameters()])  # type: ignore[misc]
    assert gradient.norm() == pytest.approx(limit, rel=1e-3)


def test_a_worker_is_paid_for_entropy_and_learns_its_values() -> None:
    model = rolled(entropy=0.1, learning_rate=1e-3)
    seen = torch.from_numpy(model.rollout_buffer.observations[:, 0])

    def now() -> tuple[float, float]:
        with torch.no_grad():
            distribution, value = model.policy.get_distribution(seen), model.policy(seen)[1]
        return float(distribution.entropy().mean()), float(value.mean())

    with torch.no_grad():
        model.policy.action_net.weight.mul_(500.0)  # choices that are far from even
        weights = parameters_to_vector(model.policy.parameters())
        model.optimiser.shared.weights.copy_(weights)
    before = now()
    model.rollout_buffer.advantages[:] = 0.0
    model.rollout_buffer.returns[:] = 2.0
    model.train()
    after = now()
    assert before[0] < after[0]
    assert before[1] < after[1] < 2.0


def test_the_rate_rises_over_the_warm_up_and_falls_to_what_shall_be_left() -> None:
    config = replace(a3c_config(1_000, learning_rate=2e-3, warm_up=400), rate_left=0.5)
    rate = model_of(config).lr_schedule
    assert rate(0.9) == pytest.approx(0.25 * 2e-3 * 0.95)
    assert rate(0.5) == pytest.approx(2e-3 * 0.75)
    assert rate(0.0) == pytest.approx(2e-3 * 0.5)


def test_what_a_worker_drove_is_counted() -> None:
    model = rolled()  # four robots, eight steps of each
    assert model.optimiser.shared.steps.tolist() == [32]
    model.optimiser.shared.steps.add_(100)  # of others
    rollout = (model.env, model._init_callback(None), model.rollout_buffer, model.n_steps)
    model.collect_rollouts(*rollout)
    assert model.num_timesteps == 164


@thorough.only
def test_one_worker_learns_the_toy_the_same_way_each_time(tmp_path: Path) -> None:
    def run(name: str, seed: int) -> list[tuple[int, float]]:
        train_toy(a3c_config(600, seed), tmp_path / name)
        return [(e.step, e.reward) for e in RunFolder(tmp_path / name).episodes()]

    first, second, other = run("a", 1), run("b", 1), run("c", 2)
    assert first == second
    assert first != other
    metrics = train_toy(a3c_config(16_000, 1), tmp_path / "learned")
    assert metrics.success_rate >= 0.9


def test_a_checkpoint_keeps_the_shared_statistics(tmp_path: Path) -> None:
    config = a3c_config(600)
    model = model_of(config)
    model.learn(600)
    save_checkpoint(tmp_path / "checkpoint.pt", model, TrainState())
    fresh = model_of(config)
    read_state(tmp_path / "checkpoint.pt", fresh)
    assert fresh.num_timesteps == model.num_timesteps >= 600
    squares = model.optimiser.shared.squares
    assert torch.equal(fresh.optimiser.shared.squares, squares)
    assert squares.abs().sum() > 0.0
    weights = fresh.policy.state_dict()
    assert all(torch.equal(v, weights[k]) for k, v in model.policy.state_dict().items())


def make_toy_and_tell(config: RunConfig, robots: int, seed: int) -> ToyVecEnv:
    """Notes how many threads numba makes in this process."""
    Path(os.environ["TOLD"], str(os.getpid())).write_text(str(numba.config.NUMBA_NUM_THREADS))
    return make_toy(config, robots, seed)


def learn_a_little(told: Path) -> None:
    os.environ |= {"TOLD": str(told), "NUMBA_NUM_THREADS": "2"}
    model = model_of(a3c_config(200, workers=3))
    model.making = replace(model.making, make_env=make_toy_and_tell)

    class UntilTold(BaseCallback):
        def _on_step(self) -> bool:
            return len(list(told.iterdir())) < 2

    model.learn(10**7, UntilTold())
    assert os.environ["NUMBA_NUM_THREADS"] == "2"


@thorough.only
def test_each_worker_keeps_to_one_core(tmp_path: Path) -> None:
    """With a second thread each, a dozen on two cores were nineteen times slower."""
    process = multiprocessing.get_context("spawn").Process(target=learn_a_little, args=(tmp_path,))
    process.start()
    process.join()
    assert process.exitcode == 0
    assert [told.read_text() for told in tmp_path.iterdir()] == ["1", "1"]


class KillOneWorker(BaseCallback):
    """Kills a worker once it has worked, and stops when its place has been filled again."""

    def __init__(self) -> None:
        super().__init__()
        self.killed, self.lost = 0, False
        self.cpu_s = 0.0
        self.robots: set[int] = set()  # of others, that ended an episode after the killing

    def _on_step(self) -> bool:
        return len(self.robots) < self.model.env.num_envs

    def _on_rollout_end(self) -> None:
        told = self.model.news()
        ended = [episode.robot for episodes, _ in told for episode in episodes]
        self.cpu_s = sum(cpu_s for _, cpu_s in told)
        if self.lost:
            self.robots.update(ended)
        elif not self.killed and ended:
            worker = multiprocessing.active_children()[0]
            self.killed = worker.pid or 0
            worker.kill()


def test_a_killed_worker_is_told_of_and_fresh_ones_go_on() -> None:
    model, callback = model_of(a3c_config(10**7, workers=2)), KillOneWorker()
    with pytest.raises(PeerLostError, match="worker 2 left: killed by SIGKILL"):
        model.learn(10**7, callback)
    assert callback.killed
    assert not multiprocessing.active_children()
    callback.lost, reached = True, model.num_timesteps
    model.learn(10**7, callback, reset_num_timesteps=False)
    assert callback.robots == {4, 5, 6, 7}
    assert callback.cpu_s > 0.0
    assert not multiprocessing.active_children()
    assert model.num_timesteps > reached > 0
