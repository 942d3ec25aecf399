"""One training by several processes: each drives its share of the robots, gradients are averaged.

Wijmans et al. 2020, "DD-PPO" (section 3), here for every algorithm that descends a gradient: each
process has worlds, pictures and replay buffer of its own and learns from them; before a step of the
optimiser all take the mean of their gradients, so that all hold the same weights. No picture passes
between processes. The same seed and number of processes give the same run.

The process that was asked to train leads. Its followers have nothing that it does not have: when
one is lost, the leader goes on with fresh ones from where its weights are.
"""

import os
import secrets
import signal
import socket
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import torch
from rich.console import Console
from stable_baselines3.common.base_class import BaseAlgorithm

from trainer.algorithms import EnvMaker, Making, find_algorithm
from trainer.config import RunConfig
from trainer.learners.episode_count import EpisodeEnd, learn_and_tell
from trainer.learners.world import learning_world
from trainer.processes import Processes
from trainer.run import RunFolder
from trainer.training.peers import KEY_BYTES, Link, PeerLostError, Peers, answer, call

_LOOK_S = 0.1  # between two looks whether followers are ready, or lost
_MOST_IN_VAIN = 3  # times that followers are replaced before anything more is learned


def share_of(config: RunConfig, rank: int) -> RunConfig:
    """What one of ``config.workers`` processes does of a run, with random numbers of its own."""
    if config.workers == 1:
        return config
    shares = find_algorithm(config.algorithm).shares
    assert shares is not None  # its processes are its own, and `RunConfig` allows no others
    learn = shares.of_each(config.learn, config.workers)
    seed = int(np.random.SeedSequence((config.seed, rank)).generate_state(1)[0] % 2**31)
    return replace(config, steps=-(-config.steps // config.workers), seed=seed, learn=learn)


class Crew:
    """The followers of a training, and what its leader does with them; one process has none."""

    def __init__(
        self, config: RunConfig, make_env: EnvMaker, folder: Path, launcher: Processes
    ) -> None:
        self._config, self._make_env, self._folder = config, make_env, folder
        self._launcher = launcher
        self._followers: list[Any] = []
        self._server: socket.socket | None = None
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
        if self._server is None:
            return True
        ready: dict[int, Link] = {}
        while len(ready) < len(self._followers):
            for ended in filter(None, map(self._launcher.ended, self._followers)):
                raise PeerLostError(ended.said or f"exit status {ended.status}, see above")
            if stopped():
                return False
            if caller := answer(self._server, self._key):
                ready[caller[0]] = caller[1]
        self._peers = Peers(0, [ready[rank] for rank in sorted(ready)], model)
        return True

    def news(self) -> list[tuple[list[EpisodeEnd], float]]:
        """What the followers tell after a rollout, see `Peers`; PeerLostError if one is lost."""
        return [] if self._peers is None else self._peers.news([])

    def close(self) -> None:
        """End the followers."""
        if self._peers is not None:
            self._peers.close()
            self._peers = None
        if self._server is not None:
            self._server.close()
        self._launcher.close()

    def _muster(self) -> None:
        host, workers = self._launcher.host, self._config.workers
        if workers == 1:
            return
        self._server, self._key = socket.create_server((host, 0)), secrets.token_bytes(KEY_BYTES)
        self._server.settimeout(_LOOK_S)
        where = host, self._server.getsockname()[1], self._key, os.getcwd()
        orders = (where, self._config, self._make_env, self._folder)
        self._followers = [self._launcher.start(follow, k, *orders) for k in range(1, workers)]


def follow(
    rank: int, leader: tuple[str, int, bytes, str], run: RunConfig, make_env: EnvMaker, folder: Path
) -> None:
    """Learn with the leader, at this host and port, until it has gone; ``rank`` is 1 or more."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is the leader's affair
    signal.signal(signal.SIGTERM, lambda *_: sys.exit())
    torch.set_num_threads(run.threads)
    os.chdir(leader[3] if os.path.isdir(leader[3]) else ".")  # of relative paths, where shared
    config, own = share_of(run, rank), RunFolder(folder)
    own.replay, own.coach = own.replay / f"worker{rank}", folder / f"coach{rank}.pt"
    env = learning_world(config, make_env)
    try:
        making = Making(config, env, own, make_env, Console(quiet=True))
        model = find_algorithm(config.algorithm).build(making)
        peers = Peers(rank, [call(*leader[:3], rank)], model)
        model.set_random_seed(config.seed + model.num_timesteps)
        learn_and_tell(model, config, rank, peers.news)
    except PeerLostError:
        return  # the leader has what it wanted; nothing here is worth keeping
    finally:
        signal.signal(signal.SIGTERM, signal.SIG_IGN)  # it leaves, and in order
