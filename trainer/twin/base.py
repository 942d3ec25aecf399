"""A shipped policy as a network that can learn on."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import onnx
import torch
from onnx import numpy_helper

from robot.contract import PolicyContract
from robot.errors import ContractError
from robot.inference.policy import SHIPPED_MODELS, read_contract
from trainer.algorithms import find_algorithm
from trainer.config import NetConfig, RunConfig
from trainer.export import check_equal
from trainer.learners.networks import GreedyNetwork
from trainer.learners.policies import build_policy

_COMPARED = 16  # noise pictures


def base_file(name: str) -> Path:
    """A file, or a shipped policy by its name."""
    shipped = SHIPPED_MODELS / f"{name}.onnx"
    return shipped if shipped.exists() else Path(name)


def load_base(path: Path) -> tuple[GreedyNetwork, PolicyContract]:
    """The network in an ONNX file that this trainer wrote, its weights with it.

    ContractError: another network than this trainer's, or one in INT8.
    """
    contract = read_contract(path)
    graph = onnx.load(str(path)).graph
    weights = {w.name: torch.from_numpy(numpy_helper.to_array(w).copy()) for w in graph.initializer}
    try:
        algorithm = find_algorithm(contract.algorithm)
        net = _widths(weights)
        config = RunConfig(
            contract.task, contract.algorithm, "", algorithm.learn, image=contract.image, net=net
        )
        network = GreedyNetwork(build_policy(config))
        network.load_state_dict(weights)
        rng = np.random.default_rng(0)
        shape = (_COMPARED, *contract.picture_shape)
        seen = {"image": rng.integers(0, 256, shape, dtype=np.uint8)}
        if contract.path_points:
            path_shape = (_COMPARED, contract.path_points)
            seen["path"] = rng.uniform(-1.0, 1.0, path_shape).astype(np.float32)
        check_equal(network, path, seen)
    except (KeyError, RuntimeError, ContractError) as error:
        raise ContractError(
            f"{path}: expected a policy in FP32 that this trainer exported, such as lane_coached"
        ) from error
    return network, contract


def _widths(weights: dict[str, torch.Tensor]) -> NetConfig:
    sizes = {name: len(w) for name, w in weights.items() if name.endswith("weight")}
    channels = tuple(n for name, n in sizes.items() if "convolutions" in name)
    path: list[int] = [n for name, n in sizes.items() if "path_fc" in name]
    first = next(n for name, n in sizes.items() if name.startswith("head"))
    return NetConfig(
        channels=channels,
        image_fc=sizes["features.image_fc.0.weight"],
        path_fc=(path[0], path[1]) if path else (64, 128),
        head_fc=first,
    )
