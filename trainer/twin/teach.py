"""A policy learns on in a twin, in the looks of before, and from what a person did.

DAgger (Ross et al. 2011) in worlds of two kinds: the twin's, and the training's against forgetting.
The expert knows the true path. Recorded frames come with the person's steering; what they did when
they took over counts most (HG-DAgger, Kelly et al. 2019).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import torch
from torch.nn.functional import cross_entropy

from robot.contract import FIVE_ACTIONS, PolicyContract
from robot.errors import ContractError
from robot.navigation.road_map import RoadMap, load_map
from sim_pybullet.batch import BatchWorld, Observation
from sim_pybullet.pool import Looks
from sim_pybullet.randomise import load_look_sampler
from sim_pybullet.tasks.spec import Choices, find_task
from trainer.division import division
from trainer.learners.networks import GreedyNetwork
from trainer.twin.examples import Examples
from trainer.twin.options import TeachConfig


class _Seen:
    """A ring of frames with the expert's choices."""

    def __init__(self, size: int, contract: PolicyContract) -> None:
        self._images = np.zeros((size, *contract.picture_shape), np.uint8)
        self._paths = np.zeros((size, max(1, contract.path_points)), np.float32)
        self._actions = np.zeros(size, np.int64)
        self._guided = contract.path_points > 0
        self.count = 0

    def add(self, seen: Observation, actions: np.ndarray) -> None:
        rows = (self.count + np.arange(len(actions))) % len(self._actions)
        self._images[rows], self._actions[rows] = seen.image, actions
        if seen.path is not None:
            self._paths[rows] = seen.path
        self.count += len(actions)

    def draw(self, rng: np.random.Generator, count: int) -> tuple[Any, Any, np.ndarray]:
        rows = rng.integers(min(self.count, len(self._actions)), size=count)
        paths = self._paths[rows] if self._guided else None
        return self._images[rows], paths, self._actions[rows]


def teach(
    network: GreedyNetwork,
    contract: PolicyContract,
    road_map: RoadMap,
    twin: Looks,
    person: Examples,
    config: TeachConfig,
    seed: int,
) -> None:
    """Let the network learn on, in place.

    ContractError: a policy of another vehicle or other actions, or of stacked pictures.
    """
    if contract.actions != FIVE_ACTIONS or contract.frames != 1:
        raise ContractError("teach: expected a policy of one picture and the five actions")
    rng, spec = np.random.default_rng(seed), find_task(contract.task)
    maps = [road_map], _training_maps(contract.task)
    looks: Sequence[Looks] = (twin, load_look_sampler("randomised"))
    worlds = []
    for k in range(2):
        lane = "both" if spec.lanes else None
        task = spec.build(maps[k], config.robots, Choices(lane, start_spread=1.6))
        many = max(1, config.painted // len(maps[k]))
        worlds.append(BatchWorld(task, looks[k], contract.image, seed + k, many))
    optimiser = torch.optim.Adam(network.parameters(), config.rate)
    seen, observed = _Seen(config.buffer, contract), [world.reset() for world in worlds]
    for step in range(config.steps):
        share = max(0.0, 1.0 - step / (config.expert_share * config.steps))
        for k, world in enumerate(worlds):
            expert = world.expert_actions().astype(np.int64)
            seen.add(observed[k], expert)
            taken = _taken(network, observed[k], expert, share, config.random_share, rng)
            observed[k] = world.step(taken).observation
        if step % config.every == 0:
            for group in optimiser.param_groups:
                group["lr"] = config.rate * (1.0 - 0.9 * step / config.steps)
            _update(network, optimiser, seen.draw(rng, config.batch), person, config.recorded, rng)
    for world in worlds:
        world.close()


def _training_maps(task: str) -> list[RoadMap]:
    rings = bool(find_task(task).lanes)
    names = division().maps.training
    fit = [name for name in names if (name == "loop" or name.startswith("rings/")) == rings]
    return [load_map(name) for name in fit[:5]]


def _taken(
    network: GreedyNetwork,
    seen: Observation,
    expert: np.ndarray,
    share: float,
    random_share: float,
    rng: np.random.Generator,
) -> np.ndarray:
    parts = {"image": seen.image} if seen.path is None else {"image": seen.image, "path": seen.path}
    learner = network.actions(parts)
    taken = np.where(rng.random(len(expert)) < share, expert, learner)
    chance = rng.integers(len(FIVE_ACTIONS), size=len(expert))
    return np.where(rng.random(len(expert)) < random_share, chance, taken)


def _update(
    network: GreedyNetwork,
    optimiser: torch.optim.Optimizer,
    drawn: tuple[Any, Any, np.ndarray],
    person: Examples,
    recorded: int,
    rng: np.random.Generator,
) -> None:
    images, paths, actions = drawn
    if len(person.actions):
        chosen = rng.choice(len(person.actions), recorded, p=person.weights / person.weights.sum())
        images = np.concatenate((images, person.images[chosen]))
        actions = np.concatenate((actions, person.actions[chosen]))
        if paths is not None and person.paths is not None:
            paths = np.concatenate((paths, person.paths[chosen]))
    told = None if paths is None else torch.from_numpy(paths)
    loss = cross_entropy(network(torch.from_numpy(images), told), torch.from_numpy(actions))
    optimiser.zero_grad()
    loss.backward()
    torch.nn.utils.clip_grad_norm_(network.parameters(), 10.0)
    optimiser.step()
