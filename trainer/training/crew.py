"""One training by several processes: each drives its share of the robots, gradients are averaged.

Wijmans et al. 2020, "DD-PPO" (section 3), here for every algorithm that descends a gradient: each
process has worlds, pictures and replay buffer of its own and learns from them; before a step of the
optimiser all take the mean of their gradients, so that all hold the same weights. No picture passes
between processes. The same seed and number of processes give the same run.

The process that was asked to train leads. Its followers have nothing that it does not have: when
one is lost, the leader goes on with fresh ones from where its weights are.
"""

import signal
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from datetime import timedelta
from pathlib import Path
from typing import Any

import numpy as np
import torch
from rich.console import Console
from stable_baselines3.common.base_class import BaseAlgorithm
from torch import distributed
from torch.nn.utils import parameters_to_vector, vector_to_parameters
from torch.utils.hooks import RemovableHandle

from trainer.algorithms import EnvMaker, Making, find_algorithm
from trainer.config import RunConfig
from trainer.learners.episode_count import learn_and_tell
from trainer.learners.world import learning_world
from trainer.processes import Processes
from trainer.run import RunFolder
from trainer.training.checkpoint import content_of, put_back

_PATIENCE = timedelta(hours=1)  # the leader may be judging its policy
_LOOK_S = 0.1  # between two looks whether followers are ready, or lost
_MOST_IN_VAIN = 3  # times that followers are replaced before anything more is learned
_READY = "ready"  # with its rank, of a follower that has its world
_FEWEST_ROBOTS = 8  # of a process: with fewer, what every step costs anyhow is most of it


class PeerLostError(RuntimeError):
    """Another process of the training has gone."""


def good_number(robots: int, cores: int) -> int:
    """Of processes for so many robots: one for each core, but none with a handful of robots."""
    fitting = (n for n in range(cores, 0, -1) if robots % n == 0 and robots // n >= _FEWEST_ROBOTS)
    return next(fitting, 1)


def share_of(config: RunConfig, rank: int) -> RunConfig:
    """What one of ``config.workers`` processes does of a run, with random numbers of its own."""
    if config.workers == 1:
        return config
    names = find_algorithm(config.algorithm).divided
    each: Any = {name: max(1, getattr(config.learn, name) // config.workers) for name in names}
    seed = int(np.random.SeedSequence((config.seed, rank)).generate_state(1)[0] % 2**31)
    steps = -(-config.steps // config.workers)
    return replace(config, steps=steps, seed=seed, learn=replace(config.learn, **each))


class Peers:
    """The processes of one training, as each of them sees the others."""

    def __init__(self, rank: int, store: distributed.Store, workers: int) -> None:
        self.rank, self.workers = rank, workers
        self._hook: RemovableHandle | None = None
        distributed.init_process_group(
            "gloo", store=store, rank=rank, world_size=workers, timeout=_PATIENCE
        )

    def begin(self, model: BaseAlgorithm) -> None:
        """Give every process the leader's weights; from now on they change alike."""
        told = [content_of(model)]
        with _unless_lost():
            distributed.broadcast_object_list(told, src=0)
        if self.rank > 0:
            put_back(model, told[0])
        self._hook = model.policy.optimizer.register_step_pre_hook(self._average)

    def gather(self, news: Any) -> list[Any]:
        """What each process tells all, by rank."""
        told: list[Any] = [None] * self.workers
        with _unless_lost():
            distributed.all_gather_object(told, news)
        return told

    def close(self) -> None:
        """Leave the others."""
        if self._hook is not None:
            self._hook.remove()
        distributed.destroy_process_group()

    def _average(self, optimizer: torch.optim.Optimizer, *_: Any) -> None:
        parameters = (p for group in optimizer.param_groups for p in group["params"])
        gradients = [p.grad for p in parameters if p.grad is not None]
        together = parameters_to_vector(gradients)
        with _unless_lost():
            distributed.all_reduce(together)
        vector_to_parameters(together / self.workers, gradients)


class Crew:
    """The followers of a training, and what its leader does with them; one process has none."""

    def __init__(
        self, config: RunConfig, make_env: EnvMaker, folder: Path, launcher: Processes
    ) -> None:
        self._config, self._make_env, self._folder = config, make_env, folder
        self._launcher = launcher
        self._followers: list[Any] = []
        self._peers: Peers | None = None
        self._muster()

    def learn(
        self, model: BaseAlgorithm, steps: int, callback: Any, stopped: Callable[[], bool]
    ) -> None:
        """As `BaseAlgorithm.learn`, with the others; lost ones are replaced.

        ``stopped`` is asked, while the others get ready, whether nobody wants that any more.
        RuntimeError: they are lost again and again, and nothing is learned.
        """
        end, vain = model.num_timesteps + steps, 0
        while True:
            before = model.num_timesteps
            try:
                if not self._joined(model, stopped):
                    return
                model.learn(end - before, callback, log_interval=None, reset_num_timesteps=False)  # type: ignore[arg-type]  # we log ourselves
                return
            except PeerLostError as error:
                vain = 0 if model.num_timesteps > before else vain + 1
                if vain > _MOST_IN_VAIN:
                    raise RuntimeError(f"expected followers that stay: {error}") from error
                self.close()
                self._muster()

    def _joined(self, model: BaseAlgorithm, stopped: Callable[[], bool]) -> bool:
        """Whether all have their worlds and begin with this model, or nobody wants it any more."""
        if self._config.workers == 1:
            return True
        wanted = [f"{_READY}{rank}" for rank in range(1, self._config.workers)]
        while not self._store.check(wanted):
            for ended in filter(None, map(self._launcher.ended, self._followers)):
                raise PeerLostError(ended.said or f"exit status {ended.status}, see above")
            if stopped():
                return False
            time.sleep(_LOOK_S)
        self._peers = Peers(0, self._store, self._config.workers)
        self._peers.begin(model)
        return True

    def news(self) -> list[Any]:
        """What the followers tell after a rollout, by rank; PeerLostError if one is lost."""
        return [] if self._peers is None else self._peers.gather(None)[1:]

    def close(self) -> None:
        """End the followers."""
        if self._peers is not None:
            self._peers.close()
            self._peers = None
        self._launcher.close()

    def _muster(self) -> None:
        host, workers = self._launcher.host, self._config.workers
        if workers == 1:
            return
        self._store = distributed.TCPStore(host, 0, workers, is_master=True, wait_for_workers=False)
        orders = (host, self._store.port, self._config, self._make_env, self._folder)
        self._followers = [
            self._launcher.start(follow, rank, *orders) for rank in range(1, workers)
        ]


@contextmanager
def _unless_lost() -> Iterator[None]:
    try:
        yield
    except RuntimeError as error:  # all that torch says of a connection that is gone
        raise PeerLostError(str(error)) from error


def follow(
    rank: int, host: str, port: int, run: RunConfig, make_env: EnvMaker, folder: Path
) -> None:
    """Learn with the leader at ``host`` until it has gone; ``rank`` is 1 or more."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is the leader's affair
    signal.signal(signal.SIGTERM, lambda *_: sys.exit())
    torch.set_num_threads(run.threads)
    config, own = share_of(run, rank), RunFolder(folder)
    own.replay /= f"worker{rank}"
    env = learning_world(config, make_env)
    try:
        store = distributed.TCPStore(host, port, run.workers, is_master=False)
        store.set(f"{_READY}{rank}", "")
        peers = Peers(rank, store, run.workers)
        making = Making(config, env, own, make_env, Console(quiet=True))
        model = find_algorithm(config.algorithm).build(making)
        peers.begin(model)
        model.set_random_seed(config.seed + model.num_timesteps)
        learn_and_tell(
            model, config, rank, lambda ended: peers.gather((ended, time.process_time()))
        )
    except (PeerLostError, distributed.DistError):
        return  # the leader has what it wanted; nothing here is worth keeping
