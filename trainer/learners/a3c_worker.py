"""One actor-learner of A3C: drives, takes n-step gradients, changes the shared weights.

Mnih et al. 2016, "Asynchronous Methods for Deep Reinforcement Learning", algorithm S3: a worker
copies the shared weights, drives a few steps, and adds its gradient to them through RMSProp whose
running mean of squares is shared as well. Unlike there it copies the weights once more before it
takes the gradient, which would else lie behind by an update of every other worker. Nobody locks
anything (Hogwild, Niu et al. 2011), so a worker that is killed leaves nothing locked.
"""

from __future__ import annotations

import multiprocessing
import signal
import time
from multiprocessing.connection import Connection
from typing import TYPE_CHECKING, Any, NamedTuple, cast

import numpy as np
import torch
from stable_baselines3.common.policies import ActorCriticPolicy
from torch.nn.functional import log_softmax, mse_loss
from torch.nn.utils import clip_grad_norm_, parameters_to_vector, vector_to_parameters

from trainer.algorithms import EnvMaker
from trainer.config import RunConfig
from trainer.envs import ScaledReward, parts_of
from trainer.learners.actor_critic import entropies
from trainer.learners.episode_count import EpisodeCount, EpisodeEnd
from trainer.learners.policies import build_policy, learning_rates

if TYPE_CHECKING:
    from trainer.algorithms.a3c import A3cConfig

Tensors = dict[str, torch.Tensor]


class Shared(NamedTuple):
    """What A3C's processes read and write together, without locks: tensors in shared memory."""

    weights: torch.Tensor  # (P,) of the policy
    squares: torch.Tensor  # (P,) RMSProp's statistics
    steps: torch.Tensor  # (W,) decisions of each worker
    cpu_ms: torch.Tensor  # (W,) milliseconds of CPU of each worker's processes
    leave: torch.Tensor  # (1,) whether the workers shall

    @classmethod
    def of(cls, weights: torch.Tensor, squares: torch.Tensor, workers: int) -> Shared:
        """Fresh memory with a copy of these weights (P,) and statistics (P,)."""
        counts = (torch.zeros(size, dtype=torch.int64) for size in (workers, workers, 1))
        return cls(*(part.share_memory_() for part in (weights.clone(), squares.clone(), *counts)))


class Orders(NamedTuple):
    """What a worker is sent out with."""

    config: RunConfig
    make_env: EnvMaker
    shared: Shared
    number: int  # of the worker
    seed: int
    first_step: int  # decisions before this process began


class Worker:
    """Drives `RunConfig.learn.robots` robots and learns from every few steps of them."""

    def __init__(self, orders: Orders) -> None:
        config, number = orders.config, orders.number
        self._config, self._shared = config, orders.shared
        self._learn = cast("A3cConfig", config.learn)
        self._number, self._first_step = number, orders.first_step
        self._rates, self._entropies = learning_rates(config), entropies(config)
        env = orders.make_env(config, config.learn.robots, orders.seed)
        self._env = ScaledReward(env, config.reward_scale)
        self._env.seed(orders.seed)
        policy = build_policy(config)
        assert isinstance(policy, ActorCriticPolicy)
        self._policy, self._weights = policy, orders.shared.weights.clone()
        vector_to_parameters(self._weights, policy.parameters())  # now views of it
        self._random = torch.Generator().manual_seed(orders.seed)
        self._seen = _tensors(self._env.reset())
        robots = config.learn.robots
        self._count = EpisodeCount(robots, config.reward_scale, number * robots)

    def close(self) -> None:
        """Free the world."""
        self._env.close()

    def learn(self) -> list[EpisodeEnd]:
        """Drive a few steps and change the shared weights; the episodes that ended."""
        self._weights.copy_(self._shared.weights)
        seen, actions, rewards, going_on, ended = [], [], [], [], []
        for _ in range(self._learn.a3c_rollout):
            seen.append(self._seen)
            actions.append(self._act())
            observation, reward, done, infos = self._env.step(actions[-1].numpy())
            ended += self._count.ended(reward, done, infos)
            rewards.append(torch.from_numpy(self._with_future(reward, done, infos)))
            going_on.append(torch.from_numpy(1.0 - done.astype(np.float32)))
            self._seen = _tensors(observation)
        with torch.no_grad():
            _, value = _evaluate(self._policy, self._seen)
        returns = n_step_returns(rewards, going_on, value, self._learn.gamma)
        # The gradient is taken where it will be applied: others have changed the weights meanwhile.
        self._weights.copy_(self._shared.weights)
        self._descend(_joined(seen), torch.cat(actions), returns.flatten())
        self._shared.steps[self._number] += len(rewards) * len(value)
        return ended

    def _act(self) -> torch.Tensor:
        with torch.no_grad():
            logits, _ = _evaluate(self._policy, self._seen)
        return torch.multinomial(logits.softmax(1), 1, generator=self._random)[:, 0]

    def _with_future(
        self, reward: np.ndarray, done: np.ndarray, infos: list[dict[str, Any]]
    ) -> np.ndarray:
        """Where an episode was only cut off, what it would still have earned is added."""
        reward = reward.astype(np.float32)
        for i in np.flatnonzero(done):
            if infos[i].get("TimeLimit.truncated"):
                last = parts_of(infos[i]["terminal_observation"])
                with torch.no_grad():
                    alone = {name: torch.from_numpy(part[None]) for name, part in last.items()}
                    reward[i] += self._learn.gamma * float(_evaluate(self._policy, alone)[1])
        return reward

    def _descend(self, seen: Tensors, actions: torch.Tensor, returns: torch.Tensor) -> None:
        learn, parameters = self._learn, list(self._policy.parameters())
        done = self._first_step + int(self._shared.steps.sum())
        left = 1.0 - done / self._config.steps
        logits, values = _evaluate(self._policy, seen)
        logs = log_softmax(logits, 1)
        chosen = logs.gather(1, actions[:, None])[:, 0]
        advantages = returns - values.detach()
        if learn.normalised:
            advantages = (advantages - advantages.mean()) / (advantages.std() + 1e-8)
        gain = (chosen * advantages).mean()
        entropy = -(logs.exp() * logs).sum(1).mean()
        loss = -gain - self._entropies(left) * entropy + learn.value * mse_loss(values, returns)
        for parameter in parameters:
            parameter.grad = None
        loss.backward()
        clip_grad_norm_(parameters, learn.max_grad_norm)
        gradient = parameters_to_vector([p.grad for p in parameters if p.grad is not None])
        warm = min(1.0, done / learn.warm_up) if learn.warm_up else 1.0
        rate = warm * self._rates(left)
        shared_rmsprop(self._shared, gradient, rate, learn.rms_decay, learn.rms_epsilon)


def shared_rmsprop(
    shared: Shared, gradient: torch.Tensor, rate: float, decay: float, epsilon: float
) -> None:
    """One step of RMSProp on the shared weights with shared statistics (Mnih et al. 2016)."""
    shared.squares.mul_(decay).addcmul_(gradient, gradient, value=1.0 - decay)
    shared.weights.addcdiv_(gradient, (shared.squares + epsilon).sqrt_(), value=-rate)


def n_step_returns(
    rewards: list[torch.Tensor], going_on: list[torch.Tensor], value: torch.Tensor, gamma: float
) -> torch.Tensor:
    """(T, N) discounted sums to the end of the rollout, ``value`` (N,) standing for the rest.

    ``going_on`` T times (N,): 0 where an episode ended with that step, else 1.
    """
    returns = []
    for reward, on in zip(reversed(rewards), reversed(going_on), strict=True):
        value = reward + gamma * on * value
        returns.append(value)
    return torch.stack(returns[::-1])


def run_worker(orders: Orders, pipe: Connection) -> None:
    """The main function of a worker's process: tells ``pipe`` of episodes until it shall stop."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is the trainer's affair
    torch.set_num_threads(orders.config.threads)
    trainer = multiprocessing.parent_process()
    worker, cpu_ms = Worker(orders), orders.shared.cpu_ms
    before_ms = int(cpu_ms[orders.number])  # of those whose place this one has taken
    while not orders.shared.leave and trainer is not None and trainer.is_alive():
        ended = worker.learn()
        cpu_ms[orders.number] = before_ms + round(1000.0 * time.process_time())
        if ended:
            pipe.send(ended)
    worker.close()


def _evaluate(policy: ActorCriticPolicy, seen: Tensors) -> tuple[torch.Tensor, torch.Tensor]:
    """Logits (N, actions) and values (N,)."""
    features = policy.features_extractor(seen["image"] if len(seen) == 1 else seen)
    actor, critic = policy.mlp_extractor(features)
    return policy.action_net(actor), policy.value_net(critic)[:, 0]


def _tensors(observation: Any) -> Tensors:
    return {name: torch.from_numpy(np.array(p)) for name, p in parts_of(observation).items()}


def _joined(seen: list[Tensors]) -> Tensors:
    return {name: torch.cat([each[name] for each in seen]) for name in seen[0]}
