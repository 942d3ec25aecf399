"""A3C: asynchronous workers, one shared policy (Mnih et al. 2016, algorithm S3), on A2C.

Each process drives robots of its own and takes A2C's gradients of a few steps; the optimiser adds
them to weights that all share, through RMSProp whose running mean of squares is shared as well.
Unlike there a worker copies the weights once more before it takes the gradient, which would else
lie behind by an update of every other worker. Nobody locks anything (Hogwild, Niu et al. 2011), so
a worker that is killed leaves nothing locked, and the training goes on with fresh ones. The first
worker is the process that trains; a single one is the same again for the same seed.
"""

import multiprocessing
import signal
import time
from contextlib import suppress
from dataclasses import dataclass, replace
from multiprocessing.connection import Connection
from multiprocessing.process import BaseProcess
from pathlib import Path
from typing import Any, NamedTuple, Self, cast

import numpy as np
import torch
from rich.console import Console
from stable_baselines3 import A2C
from torch.nn.utils import parameters_to_vector, vector_to_parameters

from trainer.algorithms import Algorithm, EnvMaker, Making
from trainer.config import RunConfig
from trainer.learners.actor_critic import CRUISE, ActorCriticConfig, FallingEntropy, on_policy
from trainer.learners.episode_count import EpisodeEnd, learn_and_tell
from trainer.learners.networks import DrivingActorCritic
from trainer.learners.policies import falling, policy_arguments
from trainer.learners.world import learning_world
from trainer.processes import LocalProcesses
from trainer.run import RunFolder
from trainer.training.peers import PeerLostError


@dataclass(frozen=True)
class A3cConfig(ActorCriticConfig):
    """See the module."""

    robots: int = 1  # of each worker
    learning_rate: float = 7e-4
    workers: int = 12
    a3c_rollout: int = 20
    rms_decay: float = 0.99
    rms_epsilon: float = 1e-8  # under the root; gradients' squares here are some 1e-7
    warm_up: int = 0  # decisions, of all, while the learning rate rises from nothing
    normalised: bool = False  # advantages to mean 0 and deviation 1 in each rollout, as in PPO


class Shared(NamedTuple):
    """What A3C's processes read and write together, without locks: tensors in shared memory."""

    weights: torch.Tensor  # (P,) of the policy
    squares: torch.Tensor  # (P,) RMSProp's statistics
    steps: torch.Tensor  # (W,) decisions of each worker


class SharedRmsprop(torch.optim.Optimizer):
    """RMSProp on weights and statistics that other processes change, too (Mnih et al. 2016)."""

    def __init__(self, parameters: Any, lr: float, decay: float, epsilon: float, workers: int):
        super().__init__((each for each in parameters if each.requires_grad), {"lr": lr})
        self._own, self._decay, self._epsilon = self.param_groups[0]["params"], decay, epsilon
        weights = parameters_to_vector(self._own).detach()
        steps = torch.zeros(workers, dtype=torch.int64)
        parts = (weights.clone(), torch.zeros_like(weights), steps)
        self.shared = Shared(*(part.share_memory_() for part in parts))

    def pull(self) -> None:
        """Take a copy of the shared weights, which go on changing."""
        vector_to_parameters(self.shared.weights.clone(), self._own)

    def step(self, closure: Any = None) -> None:  # type: ignore[override]  # noqa: ARG002
        """Change the shared weights by the gradients of one's own."""
        shared, gradient = self.shared, parameters_to_vector([p.grad for p in self._own])
        shared.squares.mul_(self._decay).addcmul_(gradient, gradient, value=1.0 - self._decay)
        root, rate = (shared.squares + self._epsilon).sqrt_(), self.param_groups[0]["lr"]
        shared.weights.addcdiv_(gradient, root, value=-rate)
        self.pull()

    def state_dict(self) -> dict[str, Any]:
        """The statistics."""
        return {"squares": self.shared.squares.clone()}

    def load_state_dict(self, state_dict: dict[str, Any]) -> None:
        """Likewise."""
        self.shared.squares.copy_(state_dict["squares"])


class A3C(FallingEntropy, A2C):
    """A worker; the first sends out the others when it begins to learn."""

    making: Making
    optimiser: SharedRmsprop  # the policy's
    number = 0

    def learn(self, total_timesteps: int, *arguments: Any, **options: Any) -> Self:
        """So many decisions of all workers together, or until the callback says stop."""
        shared = self.optimiser.shared
        if self.number:
            return super().learn(total_timesteps, *arguments, **options)
        own = (each for each in self.policy.parameters() if each.requires_grad)
        shared.weights.copy_(parameters_to_vector(own).detach())
        shared.steps.zero_()
        self.begun = 0 if options.get("reset_num_timesteps", True) else self.num_timesteps
        self._processes = LocalProcesses()
        try:
            self._send_out_others()
            return super().learn(total_timesteps, *arguments, **options)
        finally:  # wherever they are: nothing is locked, or theirs alone
            self._processes.close(within_s=0.0)

    def _send_out_others(self) -> None:
        making, shared = self.making, self.optimiser.shared
        config, count = making.config, len(shared.steps)
        self._workers: list[tuple[BaseProcess, Connection]] = []
        seeds = np.random.SeedSequence((config.seed, self.begun)).generate_state(count) % 2**31
        for k in range(1, count):
            ours, theirs = multiprocessing.Pipe(duplex=False)
            own = replace(config, seed=int(seeds[k]))
            orders = (k, self.begun, own, making.make_env, shared, theirs)
            self._workers.append((self._processes.start(_work, *orders), ours))
            theirs.close()
        self._cpu_s = [0.0] * len(self._workers)

    def collect_rollouts(self, *arguments: Any, **options: Any) -> bool:
        """By the weights of now; what the others drove meanwhile is counted."""
        self.optimiser.pull()
        before, steps = self.num_timesteps, self.optimiser.shared.steps
        goes_on = super().collect_rollouts(*arguments, **options)
        steps[self.number] += self.num_timesteps - before
        self.num_timesteps = self.begun + int(steps.sum())
        return goes_on

    def train(self) -> None:
        """The gradient is taken where it will be applied: others have changed the weights."""
        self.optimiser.pull()
        super().train()

    def news(self) -> list[tuple[list[EpisodeEnd], float]]:
        """Of each other worker the episodes that ended, and its seconds of the processor."""
        told = []
        for k, (process, pipe) in enumerate(self._workers):
            ended: list[EpisodeEnd] = []
            with suppress(EOFError, OSError):  # of one that has gone, perhaps while it was writing
                while pipe.poll():
                    more, self._cpu_s[k] = pipe.recv()
                    ended += more
            told.append((ended, self._cpu_s[k]))
            if (end := self._processes.ended(process)) and end.status:  # 0: all steps are done
                lost = PeerLostError if end.status < 0 else RuntimeError
                raise lost(
                    f"A3C: expected workers that go on until told to stop, worker {k + 2} left: "
                    f"{end.said or 'its error is above'}"
                )
        return told


def _work(
    number: int, begun: int, config: RunConfig, make_env: EnvMaker, shared: Shared, pipe: Connection
) -> None:
    """Learn in a worker's process until it is killed; ``begun`` by so many decisions before."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is the trainer's affair
    torch.set_num_threads(config.threads)

    def tell(ended: list[EpisodeEnd]) -> None:
        if ended:
            pipe.send((ended, time.process_time()))

    env = learning_world(config, make_env)
    model = build(Making(config, env, RunFolder(Path()), make_env, Console(quiet=True)))
    model.number, model.begun, model.optimiser.shared = number, begun, shared
    model.num_timesteps = begun + int(shared.steps.sum())
    learn_and_tell(model, config, number, tell)
    env.close()


def build(making: Making) -> A3C:
    """A model ready to learn."""
    config = replace(making.config, device="cpu")  # whose memory is shared
    learn = cast(A3cConfig, config.learn)
    rates = falling(learn.learning_rate, config.rate_left)

    def rate(left: float) -> float:
        warm = (1.0 - left) * config.steps / learn.warm_up if learn.warm_up else 1.0
        return min(1.0, warm) * rates(left)

    shared = {"decay": learn.rms_decay, "epsilon": learn.rms_epsilon, "workers": learn.workers}
    optimiser = {"optimizer_class": SharedRmsprop, "optimizer_kwargs": shared}
    own = {"learning_rate": rate, "policy_kwargs": policy_arguments(config) | optimiser}
    own |= {"n_steps": learn.a3c_rollout, "gae_lambda": 1.0, "use_rms_prop": False}
    own["normalize_advantage"] = learn.normalised
    model = on_policy(A3C, replace(making, config=config), **own)
    model.making, model.optimiser = making, cast(SharedRmsprop, model.policy.optimizer)
    return model


_PAPER = {"robots": 1, "learning_rate": 0.01, "warm_up": 0, "entropy": 0.02, "normalised": False}
_PAPER |= {"rms_decay": 0.9, "rms_epsilon": 0.1}  # B, section 3.1
PRESETS: dict[str, dict[str, Any]] = {
    "navigation": {"steps": 60_000},
    "track": {"learn": {"robots": 4, "warm_up": 30_000, "entropy": 0.2, "normalised": True}},
    "cruise": {**CRUISE, "relit": False},
    "paper": {"learn": _PAPER},
    "debug": {"learn": {"robots": 1, "workers": 2}},
}
ALGORITHM = Algorithm("A3C", A3cConfig(), DrivingActorCritic, build, PRESETS, shares=None)
