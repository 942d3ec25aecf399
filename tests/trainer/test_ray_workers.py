"""A training on a Ray cluster of two workers survives the death of the one that does it."""

import os
import signal
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
import torch

from robot.errors import ConfigError
from tests.trainer.chores import Chore, ToyTraining
from trainer.run import RunFolder
from trainer.workers import Outcome, RayWorkers

ray = pytest.importorskip("ray")


@pytest.fixture
def address() -> Iterator[str]:
    if not os.access("/dev/shm", os.W_OK):
        pytest.skip("Ray keeps its objects in /dev/shm, which cannot be written to here")
    from ray.cluster_utils import Cluster

    cluster = Cluster(
        initialize_head=True, head_node_args={"num_cpus": 2, "include_dashboard": False}
    )
    yield cluster.address
    cluster.shutdown()


def finish(workers: RayWorkers) -> list[Outcome]:
    outcomes: list[Outcome] = []
    while workers.busy:
        outcomes += workers.ended(0.5)
    return outcomes


def wait_for(path: Path) -> None:
    deadline = time.monotonic() + 120.0
    while not path.exists():
        assert time.monotonic() < deadline, f"no {path} in time"
        time.sleep(0.05)


@pytest.mark.slow
def test_a_killed_worker_loses_nothing(tmp_path: Path, address: str) -> None:
    training = ToyTraining(tmp_path / "toy", steps=12_000)
    training.out.mkdir()
    run = RunFolder(training.out)
    workers = RayWorkers(address)
    try:
        for job in (training, Chore(tmp_path / "a"), Chore(tmp_path / "b", "refuse")):
            workers.start(job)
        wait_for(run.checkpoint)
        killed = int((training.out / "pid").read_text())
        os.kill(killed, signal.SIGKILL)
        reached = int(torch.load(run.checkpoint, weights_only=True)["counters"]["num_timesteps"])
        outcomes = {outcome.job.title: outcome for outcome in finish(workers)}
    finally:
        workers.close()
    assert {title: outcome.status for title, outcome in outcomes.items()} == {
        "toy": 0,
        "a": 0,
        "b": 2,
    }
    assert (tmp_path / "a").read_text() == "write 1"
    assert outcomes["b"].said == "expected this, got that"
    assert int((training.out / "pid").read_text()) != killed
    steps = [episode.step for episode in run.episodes()]
    assert steps == sorted(steps)
    assert len(steps) >= 12_000 // 16  # of 16 decisions at most: none of them is missing
    assert 0 < reached < 12_000


def test_no_cluster_is_wrong_input() -> None:
    with pytest.raises(ConfigError, match="expected the address of a running cluster"):
        RayWorkers("nonsense")
