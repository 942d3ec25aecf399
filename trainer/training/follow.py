"""A follower: one of the processes of a training that `trainer.training.crew` describes."""

from __future__ import annotations

import signal
import sys
import time

import torch
from rich.console import Console
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.logger import Logger
from torch import distributed

from trainer.algorithms import Making, find_algorithm
from trainer.learners.episode_count import EpisodeCount, EpisodeEnd
from trainer.run import RunFolder
from trainer.training.crew import READY, Orders, PeerLostError, Peers, share_of
from trainer.training.worlds import learning_world


class _Tell(BaseCallback):
    """Tells the leader of episodes, and of the processor's seconds, after every rollout."""

    def __init__(self, peers: Peers, count: EpisodeCount) -> None:
        super().__init__()
        self._peers, self._count = peers, count
        self._ended: list[EpisodeEnd] = []

    def _on_step(self) -> bool:
        seen = self.locals
        self._ended += self._count.ended(seen["rewards"], seen["dones"], seen["infos"])
        return True

    def _on_rollout_end(self) -> None:
        self._peers.gather((self._ended, time.process_time()))
        self._ended = []


def follow(orders: Orders) -> None:
    """Learn with the leader until it has gone."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is the leader's affair
    signal.signal(signal.SIGTERM, lambda *_: sys.exit())
    torch.set_num_threads(orders.config.threads)
    config, rank = share_of(orders.config, orders.rank), orders.rank
    env = learning_world(config, orders.make_env)
    workers = orders.config.workers
    try:
        store = distributed.TCPStore(orders.host, orders.port, workers, is_master=False)
        store.set(f"{READY}{rank}", "")
        peers = Peers(rank, store, workers)
        folder = RunFolder(orders.folder)
        folder.replay /= f"worker{rank}"
        making = Making(config, env, folder, orders.make_env, Console(quiet=True))
        model = find_algorithm(config.algorithm).build(making)
        peers.begin(model)
        model.set_random_seed(config.seed + model.num_timesteps)
        model.set_logger(Logger(None, []))
        robots = config.learn.robots
        tell = _Tell(peers, EpisodeCount(robots, config.reward_scale, rank * robots))
        steps = max(0, config.steps - model.num_timesteps)
        model.learn(steps, tell, log_interval=None, reset_num_timesteps=False)  # type: ignore[arg-type]  # no log
    except (PeerLostError, distributed.DistError):
        return  # the leader has what it wanted; nothing here is worth keeping
