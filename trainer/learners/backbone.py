"""The backbone of a policy: the layers of sight that see, as they are.

Sight learns from the map's own labels on hundreds of thousands of pictures, and sees photographs
as well as pictures of its training. Who learns to drive by what it sees keeps that.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import onnx
import torch
from onnx import numpy_helper
from torch import nn

from robot.errors import ContractError
from robot.inference.network_file import open_network

_LAYERS = 7 * ["Conv"] + ["Gemm"]


class _Twice(nn.Module):
    """Two convolutions beside a short cut, as of `trainer.sight.network`."""

    def __init__(self, first: nn.Module, second: nn.Module) -> None:
        super().__init__()
        self.first, self.second = first, second

    def forward(self, images: torch.Tensor) -> torch.Tensor:
        return torch.relu(images + self.second(torch.relu(self.first(images))))


def read_backbone(path: Path) -> nn.Sequential:
    """All layers of an ONNX sight but the last, frozen: (N, 3, 40, 80) in -1..1 -> (N, 192).

    ``path``: the sight, or a policy that has one for its backbone. ContractError for others.
    """
    remedy = "take a sight in FP32, or a policy that has one for its backbone"
    open_network(path, remedy)  # what is absent or damaged ends here
    graph = onnx.load(str(path)).graph
    values = {each.name: numpy_helper.to_array(each) for each in graph.initializer}
    nodes = [node for node in graph.node if node.op_type in ("Conv", "Gemm")][: len(_LAYERS)]
    layers = [[values[name] for name in node.input[1:] if name in values] for node in nodes]
    if [node.op_type for node in nodes] != _LAYERS or any(len(each) != 2 for each in layers):
        raise ContractError(f"{path}: expected the layers of a sight, got others; {remedy}")
    a, b, c, d, e, f, g, dense = (_layer(*each) for each in layers)
    body = (a, nn.ReLU(), b, nn.ReLU(), _Twice(c, d), e, nn.ReLU(), _Twice(f, g))
    return nn.Sequential(*body, nn.Flatten(), dense, nn.ReLU()).requires_grad_(False)


def _layer(weight: np.ndarray, bias: np.ndarray) -> nn.Module:
    to, of, *size = weight.shape
    layer: nn.Conv2d | nn.Linear = nn.Linear(of, to)
    if size:
        layer = nn.Conv2d(of, to, size[0], 1 if of == to else 2, size[0] // 2)
    state = {"weight": weight, "bias": bias}
    layer.load_state_dict({name: torch.from_numpy(part.copy()) for name, part in state.items()})
    return layer
