"""A shipped policy learns on in a twin, in the looks of before, and from what a person did; proof.

DAgger (Ross et al. 2011) in worlds of two kinds: the twin's, and the training's against forgetting.
The expert knows the true path. Recorded frames come with the person's steering; what they did when
they took over counts most (HG-DAgger, Kelly et al. 2019). Without a map there is no twin.

Who sees by the layers of sight goes on seeing so, and in the looks of before it is right itself.
"""

import copy
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import onnx
import torch
from onnx import numpy_helper
from torch.nn.functional import cross_entropy

from robot.contract import FIVE_ACTIONS, LEAST_FORETOLD, PolicyContract
from robot.errors import ConfigError, ContractError, DuckpilotError
from robot.inference.policy import SHIPPED_MODELS, Translator, read_contract
from robot.navigation.road_map import RoadMap, load_map
from robot.typed_config import named_file
from robot.vision.sight import OnnxSight
from sim_pybullet.batch import BatchWorld
from sim_pybullet.episodes import Looks
from sim_pybullet.randomise import Sites, load_look_sampler
from sim_pybullet.tasks.spec import Choices, find_task
from trainer.algorithms import find_algorithm
from trainer.config import NetConfig, RunConfig
from trainer.division import division
from trainer.export import check_equal, noise_seen
from trainer.learners.backbone import Backbone
from trainer.learners.networks import GreedyNetwork, unhedged
from trainer.learners.policies import build_policy
from trainer.resumable import descend, set_rate
from trainer.sight.cli import SHIPPED
from trainer.twin.examples import Examples, foretold
from trainer.twin.manner import Manner, manner_of

USUAL = ("randomised", "wide")  # looks that are not to be forgotten


@dataclass(frozen=True)
class TeachConfig:
    """How much of what."""

    steps: int = 2_700  # decisions of each robot
    robots: int = 12  # in each of the two worlds
    batch: int = 128  # frames of worlds in an update; recorded ones come on top
    recorded: int = 32  # recorded frames in an update
    every: int = 2  # decisions between updates
    rate: float = 4e-4  # of learning, at first
    expert_share: float = 0.15  # of the steps, while the expert's share of the driving falls to 0
    random_share: float = 0.08  # of the actions, so that recoveries are seen
    painted: int = 10  # worlds of each kind


def how_much(on_map: bool, steps: int | None = None) -> TeachConfig:
    """What `teach` does; without a map only recordings tell of the road."""
    usual = TeachConfig() if on_map else TeachConfig(900, batch=32, recorded=224)
    return usual if steps is None else replace(usual, steps=steps)


def base_file(name: str) -> Path:
    """A file, or a shipped policy by its name; ConfigError for neither."""
    shipped = {file.stem: file for file in SHIPPED_MODELS.glob("*.onnx")}
    return shipped[name] if name in shipped else named_file("base", name, shipped)


def new_model(folder: Path) -> Path:
    """Where a taught policy is to lie; ConfigError unless what lies there was left half-way."""
    path = folder / "model.onnx"
    if path.exists() and ((left := read_contract(path)).proof or not left.taught_from):
        raise ConfigError(f"{path}: expected no policy here yet; choose another --out")
    return path


def load_base(path: Path) -> tuple[GreedyNetwork, PolicyContract]:
    """The network in an ONNX file that this trainer wrote, its weights with it.

    ContractError: another network than this trainer's, or one in INT8.
    """
    contract = read_contract(path)
    graph = onnx.load(str(path)).graph
    weights = {w.name: torch.from_numpy(numpy_helper.to_array(w).copy()) for w in graph.initializer}
    try:
        learn = find_algorithm(contract.algorithm).learn
        net, image = _widths(weights, path), contract.image
        how: dict[str, Any] = {"image": image, "net": net, "commands": contract.commands}
        run = RunConfig(contract.task, contract.algorithm, "", learn, **how)
        network = GreedyNetwork(build_policy(run))
        if not any(name.endswith(".costs") for name in weights):
            network.head = unhedged(network.head)
        network.load_state_dict(weights)
        check_equal(network, path, noise_seen(contract, 16))
    except (KeyError, RuntimeError, DuckpilotError) as error:
        raise ContractError(
            f"{path}: expected a policy in FP32 that this trainer exported, such as lane_coached"
        ) from error
    return network, contract


def _widths(weights: dict[str, torch.Tensor], file: Path) -> NetConfig:
    sizes = {name: len(w) for name, w in weights.items() if name.endswith("weight")}
    path: list[int] = [n for name, n in sizes.items() if "path_fc" in name]
    sees = any("convolutions" in name and w.ndim == 2 for name, w in weights.items())
    return NetConfig(
        backbone=str(file) if sees else "",
        channels=tuple(n for name, n in sizes.items() if "convolutions" in name),
        image_fc=sizes["features.image_fc.0.weight"],
        path_fc=(path[0], path[1]) if path else (64, 128),
        head_fc=next(n for name, n in sizes.items() if name.startswith("head")),
    )


def teach(
    network: GreedyNetwork,
    contract: PolicyContract,
    twin: tuple[RoadMap, Looks] | None,
    person: Examples,
    config: TeachConfig,
    seed: int,
    translator: Translator | None = None,
) -> None:
    """Let the network learn on, in place; it sees the twin through a ``translator``, if any.

    ContractError: a policy of another vehicle or other actions, or of stacked pictures.
    """
    if contract.actions != FIVE_ACTIONS or contract.frames != 1:
        raise ContractError("teach: expected a policy of one picture and the five actions")
    before = copy.deepcopy(network) if isinstance(network.features.convolutions, Backbone) else None
    torch.set_num_threads(1)
    rng, robots = np.random.default_rng(seed), config.robots
    worlds = _worlds(contract, twin, config, seed, translator)
    optimiser = torch.optim.Adam(network.parameters(), config.rate)
    observed, frames = [world.reset() for world in worlds], len(worlds) * robots * config.steps
    seen = {n: np.zeros((frames, *p.shape[1:]), p.dtype) for n, p in person.observed.items()}
    wanted, count = np.zeros((frames, len(FIVE_ACTIONS)), np.float32), 0
    manner = None if twin else _manner(network, contract, person)
    person = manner.smoothed(person) if manner else person
    recorded, often = person.observed, person.weights / person.weights.sum()
    for step in range(config.steps):
        share = max(0.0, 1.0 - step / (config.expert_share * config.steps))
        for k, world in enumerate(worlds):
            now = {name: getattr(observed[k], name) for name in seen}
            new, expert = slice(count, count + robots), world.expert_actions()
            count += robots
            for name, part in now.items():
                seen[name][new] = part
            wanted[new] = np.eye(len(FIVE_ACTIONS))[expert]
            if before and k == len(worlds) - 1:
                wanted[new] = before.logits(now).detach().softmax(1).numpy()
            if manner:
                wanted[new] = manner.shares(now["image"], wanted[new])
            taken = np.where(rng.random(robots) < share, expert, network.actions(now))
            chance = rng.integers(len(FIVE_ACTIONS), size=robots)
            taken = np.where(rng.random(robots) < config.random_share, chance, taken)
            observed[k] = world.step(taken).observation
        if step % config.every == 0:
            set_rate([optimiser], config.rate * (1.0 - 0.9 * step / config.steps))
            rows = rng.integers(count, size=config.batch)
            drawn, told = {name: part[rows] for name, part in seen.items()}, wanted[rows]
            if len(person.shares):
                some = rng.choice(len(person.shares), config.recorded, p=often)
                drawn = {n: np.concatenate((p, recorded[n][some])) for n, p in drawn.items()}
                told = np.concatenate((told, person.shares[some]))
            descend(optimiser, cross_entropy(network.logits(drawn), torch.from_numpy(told)), 10.0)
    for world in worlds:
        world.close()


def _manner(network: GreedyNetwork, contract: PolicyContract, person: Examples) -> Manner | None:
    """Of a person who does not steer as the network does, if it can be told."""
    same, clear = foretold(network.actions(person.observed), person, contract)
    return None if same >= LEAST_FORETOLD * clear else manner_of(person, OnnxSight(SHIPPED))


def pose_error(contract: PolicyContract) -> str | None:
    """What navigators learn and are proven with: else they would trust the path, not pictures."""
    return "arena" if contract.path_points else None


def _worlds(
    contract: PolicyContract,
    twin: tuple[RoadMap, Looks] | None,
    config: TeachConfig,
    seed: int,
    translator: Translator | None,
) -> list[BatchWorld]:
    """One of training maps and looks, and the twin's, if any."""
    spec, names = find_task(contract.task), division().maps.training
    rings = bool(spec.lanes)
    fit = [name for name in names if (name == "loop" or name.startswith("rings/")) == rings]
    usual = Sites(load_look_sampler(name, pose_error(contract)) for name in USUAL)
    kinds: list[Any] = [([load_map(n) for n in fit[:5]], usual, None)]
    if twin is not None:
        kinds.insert(0, ([twin[0]], twin[1], translator))
    worlds = []
    for k, (maps, looks, shown) in enumerate(kinds):
        task = spec.build(maps, config.robots, Choices("both" if rings else None, start_spread=1.6))
        how = looks, contract.image, seed + k, max(1, config.painted // len(maps))
        worlds.append(BatchWorld(task, *how, translator=shown, commands=contract.commands))
    return worlds
