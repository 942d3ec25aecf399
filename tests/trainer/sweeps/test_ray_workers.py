"""A training on a Ray cluster of two workers survives the death of the one that does it."""

import os
import signal
import socket
import threading
import time
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import pytest
import torch
from rich.console import Console

from robot.errors import ConfigError
from tests import thorough
from tests.trainer.chores import Chore, ToyTraining
from tests.trainer.toy import BrightColumn, ToyVecEnv, make_toy, toy_config
from trainer import processes
from trainer.cli import main
from trainer.config import RunConfig
from trainer.processes import RayProcesses
from trainer.run import RunFolder
from trainer.sweeps.sweep import RETRIES, last_words, perform
from trainer.training.train import train

ray = pytest.importorskip("ray")


@pytest.fixture
def address(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[str]:
    monkeypatch.setenv("RAY_worker_niceness", "0")  # else a busy machine leaves them no time
    from ray.cluster_utils import Cluster

    node: dict[str, object] = {"num_cpus": 2, "num_gpus": 1, "include_dashboard": False}
    if not os.access("/dev/shm", os.W_OK):  # where Ray keeps its objects
        node["plasma_directory"] = str(tmp_path)
    cluster = Cluster(initialize_head=True, head_node_args=node)
    yield cluster.address
    cluster.shutdown()


def wait_for(path: Path) -> None:
    deadline = time.monotonic() + 120.0
    while not path.exists():
        assert time.monotonic() < deadline, f"no {path} in time"
        time.sleep(0.05)


@thorough.only
def test_a_killed_worker_loses_nothing(
    tmp_path: Path, address: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    training = ToyTraining(tmp_path / "toy", steps=8_000)
    training.out.mkdir()
    run = RunFolder(training.out)
    workers = RayProcesses(address, RETRIES)
    try:
        jobs = (training, Chore(tmp_path / "a"), Chore(tmp_path / "b", "refuse"))
        asked = [(job, workers.start(perform, job, str(tmp_path))) for job in jobs]
        wait_for(run.checkpoint)
        killed = int((training.out / "pid").read_text())
        os.kill(killed, signal.SIGKILL)
        reached = int(torch.load(run.checkpoint, weights_only=True)["counters"]["num_timesteps"])
        ray.wait([each for _, each in asked], num_returns=3, timeout=120.0)
        ended = [workers.ended(each) for _, each in asked]
        # Ray aborts this process now and then when it must cancel what has just ended.
        monkeypatch.setattr(ray, "cancel", lambda _, **how: pytest.fail("cancels what has ended"))
    finally:
        workers.close()
        ray.shutdown()
    assert [each and each.status for each in ended] == [0, 0, 2]
    assert (tmp_path / "a").read_text() == "write 1"
    assert ended[2] is not None
    assert last_words(jobs[2], ended[2]) == "expected this, got that"
    assert int((training.out / "pid").read_text()) != killed
    steps = [episode.step for episode in run.episodes()]
    assert steps == sorted(steps)
    cut_off = 2 * toy_config("ppo", 1).learn.robots  # by the kill, and by the end
    assert len(steps) >= 8_000 // 16 - cut_off  # of 16 decisions at most: none is missing
    assert 0 < reached < 8_000


def test_a_process_has_the_gpu_that_it_is_to_have(
    address: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(processes, "ANSWER_S", 60.0)
    try:
        workers = RayProcesses(address, gpus=1.0)
        count = workers.start(lambda: len(ray.get_gpu_ids()))
        ray.wait([count], timeout=120.0)
        assert workers.ended(count) == (1, "")
        with pytest.raises(ConfigError, match="gpus: expected at most the cluster's 1, got 2"):
            RayProcesses(address, gpus=2.0)
    finally:
        ray.shutdown()


def test_gpus_are_asked_of_a_cluster_alone(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["train", "--gpus", "1", "--out", str(tmp_path / "run")]) == 2
    assert "gpus: expected --ray as well, got 1" in capsys.readouterr().err
    assert not (tmp_path / "run").exists()


def test_no_cluster_is_wrong_input() -> None:
    with pytest.raises(ConfigError, match="expected the address of a running cluster"):
        RayProcesses("nonsense")


@pytest.mark.parametrize("listens", [True, False])
def test_where_no_cluster_answers_is_wrong_input(
    listens: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(processes, "ANSWER_S", 2.0)
    with socket.create_server(("127.0.0.1", 0)) as silent:
        address = f"127.0.0.1:{silent.getsockname()[1] if listens else 1}"
        with pytest.raises(ConfigError, match="expected the address of a running cluster"):
            RayProcesses(address)


class Hesitant(ToyVecEnv):
    """Past its hundredth step it drives on only once a second follower has come."""

    count = 0
    maker: "HesitantMaker"

    def step_wait(self) -> Any:
        self.count += 1
        while self.count > 100 and len(list(self.maker.arrived.iterdir())) < 2:
            self.maker.under_way.touch()
            time.sleep(0.01)
        return super().step_wait()


@dataclass(frozen=True)
class HesitantMaker:
    """Makes the worlds; a follower is a process on one of these nodes, and says where it is."""

    arrived: Path
    nodes: tuple[str, ...]

    @property
    def under_way(self) -> Path:
        return self.arrived.with_name("under way")

    def __call__(self, config: RunConfig, robots: int, seed: int) -> ToyVecEnv:
        where = ray.get_runtime_context().get_node_id()
        if where not in self.nodes:
            return make_toy(config, robots, seed)
        (self.arrived / where).touch()
        env = Hesitant([BrightColumn] * robots)
        env.maker = self
        env.seed(seed)
        return env


@pytest.mark.slow
def test_a_training_over_a_cluster_survives_the_loss_of_a_node(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("RAY_worker_niceness", "0")
    from ray.cluster_utils import Cluster

    shared: dict[str, object] = {"include_dashboard": False}
    if not os.access("/dev/shm", os.W_OK):
        shared["plasma_directory"] = str(tmp_path)
    cluster = Cluster(initialize_head=True, head_node_args={"num_cpus": 0, **shared})
    nodes = [cluster.add_node(num_cpus=1) for _ in range(2)]
    config = replace(toy_config("ppo", 6_000), workers=2)
    config = replace(config, evaluation=replace(config.evaluation, stop_after_perfect=0))
    run = RunFolder(tmp_path / "toy")
    make = HesitantMaker(tmp_path / "arrived", tuple(node.node_id for node in nodes))
    make.arrived.mkdir()

    def lose_the_node() -> None:
        wait_for(make.under_way)
        (busy,) = [node for node in nodes if (make.arrived / node.node_id).exists()]
        cluster.remove_node(busy, allow_graceful=False)

    losing = threading.Thread(target=lose_the_node)
    try:
        launcher = RayProcesses(cluster.address)
        assert launcher.cores == 3
        losing.start()
        metrics = train(config, run, make, Console(quiet=True), launcher=launcher)
        losing.join()
    finally:
        ray.shutdown()
        cluster.shutdown()
    assert {each.name for each in make.arrived.iterdir()} == set(make.nodes)
    assert metrics.stopped_by == "steps"
    steps = [episode.step for episode in run.episodes()]
    assert steps == sorted(steps)
    assert {episode.robot for episode in run.episodes()} == set(range(2 * config.learn.robots))
