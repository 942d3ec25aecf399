"""A3C: asynchronous workers, one shared policy, as a stable-baselines3 algorithm among the others.

`trainer.learners.a3c_worker` learns; this module sends workers out, replaces those that were
killed, and shows callbacks a still picture of the weights. A single worker learns in this very
process, step by step with the callbacks: such a run is the same again for the same seed.
"""

from __future__ import annotations

import itertools
from collections.abc import Generator
from contextlib import closing
from dataclasses import dataclass
from multiprocessing import forkserver
from multiprocessing.connection import Connection, wait
from multiprocessing.process import BaseProcess
from typing import Any, cast

import numpy as np
import torch
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.policies import ActorCriticPolicy
from stable_baselines3.common.vec_env import VecEnv
from torch import multiprocessing
from torch.nn.utils import parameters_to_vector, vector_to_parameters

from trainer.algorithms import Algorithm, EnvMaker
from trainer.config import RunConfig
from trainer.learners.a3c_worker import Orders, Shared, Worker, run_worker
from trainer.learners.actor_critic import CRUISE, ActorCriticConfig
from trainer.learners.episode_count import EpisodeEnd
from trainer.learners.networks import DrivingActorCritic
from trainer.learners.policies import ChannelLast, build_policy
from trainer.one_thread import one_thread_each

POLL_S = 0.1  # between two looks at what the workers did
_LEAVE_S = 20.0  # a worker that shall stop gets so long to finish its rollout
_MOST_REPLACED = 100  # more deaths than that are no accidents


@dataclass(frozen=True)
class A3cConfig(ActorCriticConfig):
    """Asynchronous advantage actor-critic (Mnih et al. 2016)."""

    robots: int = 1  # of each worker
    learning_rate: float = 7e-4
    workers: int = 12
    a3c_rollout: int = 20
    rms_decay: float = 0.99
    rms_epsilon: float = 1e-8  # under the root; gradients' squares here are some 1e-7
    warm_up: int = 0  # decisions, of all, while the learning rate rises from nothing
    normalised: bool = False  # advantages to mean 0 and deviation 1 in each rollout, as in PPO


class A3C(ChannelLast, BaseAlgorithm):
    """Of a run with an `A3cConfig`; ``make_env`` builds a worker's world, in its process."""

    def __init__(self, config: RunConfig, make_env: EnvMaker, env: VecEnv) -> None:
        self._config, self._learn = config, cast(A3cConfig, config.learn)
        self._make_env = make_env
        self.replaced = 0  # workers that were killed
        self.workers_cpu_s = 0.0  # CPU seconds of processes other than this one
        super().__init__(
            ActorCriticPolicy,
            env,
            config.learn.learning_rate,
            seed=config.seed,
            device="cpu",
            support_multi_env=True,
        )
        self._setup_model()

    def _setup_model(self) -> None:
        self.set_random_seed(self.seed)
        policy = build_policy(self._config)
        assert isinstance(policy, ActorCriticPolicy)
        self.policy = policy
        # Holds RMSProp's statistics in checkpoints; it never takes a step itself.
        self.policy.optimizer = torch.optim.RMSprop(policy.parameters(), eps=1e-5)

    def set_random_seed(self, seed: int | None = None) -> None:
        """What the next workers' random numbers follow from."""
        self._seed = seed or 0
        super().set_random_seed(seed)

    def learn(self, total_timesteps: int, callback: Any = None, *_: Any, **options: Any) -> A3C:
        """So many decisions of all workers together, or until the callback says stop."""
        anew = options.get("reset_num_timesteps", True)
        total, callback = self._setup_learn(total_timesteps, callback, anew)
        if self.num_timesteps >= total:
            return self
        assert isinstance(self.policy, ActorCriticPolicy)
        weights = parameters_to_vector(self.policy.parameters()).detach()
        shared = Shared.of(weights, self._squares(), self._learn.workers)
        begun = self.num_timesteps
        callback.on_training_start(locals(), globals())
        with closing(self._episodes(shared)) as batches:
            for ended in batches:
                self._take(shared, begun)
                callback.update_locals({"episodes": ended})
                if not callback.on_step() or self.num_timesteps >= total:
                    break
        self._take(shared, begun)
        callback.on_training_end()
        return self

    def _episodes(self, shared: Shared) -> Generator[list[EpisodeEnd], None, None]:
        """Again and again the episodes that ended meanwhile."""
        seeds = np.random.SeedSequence((self._seed, self.num_timesteps))
        orders = [
            Orders(self._config, self._make_env, shared, k, int(seed), self.num_timesteps)
            for k, seed in enumerate(seeds.generate_state(self._learn.workers) % 2**31)
        ]
        if len(orders) == 1:
            with closing(Worker(orders[0])) as worker:
                while True:
                    yield worker.learn()
        with closing(_Crew(orders)) as crew:
            while True:
                yield crew.episodes()
                self.replaced = crew.replaced

    def _take(self, shared: Shared, begun: int) -> None:
        """A copy of the shared weights and statistics, which go on changing."""
        vector_to_parameters(shared.weights.clone(), self.policy.parameters())
        parameters = list(self.policy.parameters())
        sizes = [parameter.numel() for parameter in parameters]
        for parameter, part in zip(parameters, shared.squares.clone().split(sizes), strict=True):
            square = {"step": torch.tensor(0.0), "square_avg": part.view_as(parameter)}
            self.policy.optimizer.state[parameter] = square
        self.num_timesteps = begun + int(shared.steps.sum())
        self.workers_cpu_s = float(shared.cpu_ms.sum()) / 1000.0

    def _squares(self) -> torch.Tensor:
        """(P,) the statistics of the run so far; zeros at its beginning."""
        state = self.policy.optimizer.state
        parts = [
            state[p]["square_avg"].flatten() if p in state else torch.zeros(p.numel())
            for p in self.policy.parameters()
        ]
        return torch.cat(parts)


class _Crew:
    """The worker processes; dead ones are replaced."""

    def __init__(self, orders: list[Orders]) -> None:
        # A server that has imported everything forks the workers: quick, and no threads are copied.
        self._context = multiprocessing.get_context("forkserver")
        self._context.set_forkserver_preload(["trainer.learners.a3c_worker"])
        with one_thread_each():
            forkserver.ensure_running()
        self._orders, self._shared = orders, orders[0].shared
        self._workers = [self._send_out(each) for each in orders]
        self.replaced = 0

    def episodes(self) -> list[EpisodeEnd]:
        """What ended within the next moment."""
        pipes = [pipe for _, pipe in self._workers]
        deaths = [process.sentinel for process, _ in self._workers]
        ready = wait([*pipes, *deaths], POLL_S)
        ended = [_receive(pipe) for pipe in pipes if pipe in ready]
        for k, (process, pipe) in enumerate(self._workers):
            if process.exitcode is not None:
                pipe.close()
                self._replace(k, process.exitcode)
        return list(itertools.chain.from_iterable(ended))

    def close(self) -> None:
        """Let the workers finish their rollouts and leave."""
        self._shared.leave.fill_(1)
        for process, pipe in self._workers:
            process.join(_LEAVE_S)
            process.kill()
            process.join()
            pipe.close()

    def _send_out(self, orders: Orders) -> tuple[BaseProcess, Connection]:
        ours, theirs = self._context.Pipe(duplex=False)
        process = self._context.Process(target=run_worker, args=(orders, theirs), daemon=True)
        process.start()
        theirs.close()
        return process, ours

    def _replace(self, k: int, exitcode: int) -> None:
        self.replaced += 1
        if exitcode >= 0 or self.replaced > _MOST_REPLACED:
            raise RuntimeError(
                f"A3C: expected workers that go on until told to stop, worker {k} left with exit "
                f"status {exitcode} ({self.replaced} replaced so far); its error is above"
            )
        again = self._orders[k]._replace(seed=self._orders[k].seed + self.replaced)
        self._workers[k] = self._send_out(again)


def _receive(pipe: Connection) -> list[EpisodeEnd]:
    """A worker's news; none when it died while it was writing."""
    try:
        news: list[EpisodeEnd] = pipe.recv()
    except (EOFError, OSError):
        return []
    return news


ALGORITHM = Algorithm(
    title="A3C",
    learn=A3cConfig(),
    policy=DrivingActorCritic,
    build=lambda making: A3C(making.config, making.make_env, making.env),
    presets={
        "navigation": {"steps": 60_000},
        "track": {
            "learn": {
                "robots": 4,
                "learning_rate": 7e-4,
                "warm_up": 30_000,
                "entropy": 0.2,
                "normalised": True,
            }
        },
        "cruise": {**CRUISE, "relit": False},  # workers have worlds of their own
        "paper": {  # B, section 3.1
            "learn": {
                "robots": 1,
                "learning_rate": 0.01,
                "rms_decay": 0.9,
                "rms_epsilon": 0.1,
                "entropy": 0.02,
                "normalised": False,
                "warm_up": 0,
            }
        },
        "debug": {"learn": {"robots": 1, "workers": 2}},
    },
    own_worlds=True,
)
