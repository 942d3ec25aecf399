"""A network of sight that learns on from a file, which may tell less than it."""

from __future__ import annotations

from functools import partial
from pathlib import Path

import numpy as np
import onnx
import torch
from onnx import numpy_helper
from torch import nn

from robot.errors import ContractError
from robot.vision.sight import COLUMNS, OnnxSight
from trainer.sight.network import SightNetwork


@torch.no_grad()
def take_over(network: SightNetwork, path: Path, images: np.ndarray) -> None:
    """Give a new network what a file of sight knows; columns that it does not tell begin anew.

    Files have batch normalisation folded in; images (N, 40, 80, 3) tell what it is to undo.

    ContractError: a file of another network.
    """
    columns = [COLUMNS.index(column) for column in OnnxSight(path).contract.columns]
    graph = onnx.load(str(path)).graph
    weights = {w.name: torch.from_numpy(numpy_helper.to_array(w).copy()) for w in graph.initializer}
    convolutions, norms = (
        [each for each in network.body.modules() if isinstance(each, kind)]
        for kind in (nn.Conv2d, nn.BatchNorm2d)
    )
    hidden = next(each for each in network.body if isinstance(each, nn.Linear))
    try:
        folded = [
            [weights[name] for name in node.input[1:]]
            for node in graph.node
            if node.op_type == "Conv"
        ]
        for convolution, norm, (weight, bias) in zip(convolutions, norms, folded, strict=True):
            convolution.weight.copy_(weight)
            norm.register_forward_pre_hook(partial(_undo, bias))
        hidden.weight.copy_(weights["body.6.weight"])
        hidden.bias.copy_(weights["body.6.bias"])
        network.head.weight[columns] = weights["head.weight"]
        network.head.bias[columns] = weights["head.bias"]
    except (KeyError, RuntimeError, TypeError, ValueError) as error:
        raise ContractError(
            f"{path}: expected sight in FP32 that train-sight of this kind of network wrote"
        ) from error
    network.eval()
    network.raw(torch.from_numpy(images))
    for norm in norms:
        norm._forward_pre_hooks.clear()
    network.train()


def _undo(bias: torch.Tensor, norm: nn.BatchNorm2d, inputs: tuple[torch.Tensor]) -> None:
    """Let a normalisation do to these inputs nothing but add this bias."""
    variance, mean = torch.var_mean(inputs[0], (0, 2, 3), correction=0)
    norm.running_mean, norm.running_var = mean, variance
    norm.weight.copy_((variance + norm.eps).sqrt())
    norm.bias.copy_(bias + mean)
