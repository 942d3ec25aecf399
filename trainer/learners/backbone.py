"""The backbone of a policy: the layers of sight that see, as they are.

Sight learns from the map's own labels on hundreds of thousands of pictures, and sees photographs
as well as pictures of its training. Who learns to drive by what it sees keeps that.
"""

from collections.abc import Callable
from pathlib import Path
from typing import Self, cast

import numpy as np
import onnx
import torch
from stable_baselines3.common.utils import get_device
from torch import nn

from robot.errors import ContractError
from robot.inference.network_file import open_network

HALF = torch.ops.mkldnn._is_mkldnn_bf16_supported()  # then a third of the time
_LAYERS = 7 * ["Conv"] + ["Gemm"]


class Twice(nn.Module):
    """Two convolutions beside a short cut (He et al. 2016)."""

    def __init__(self, first: nn.Module, second: nn.Module) -> None:
        super().__init__()
        self.first, self.second = first, second

    def forward(self, images: torch.Tensor) -> torch.Tensor:
        """(N, C, H, W) to (N, C, H, W)."""
        return torch.relu(images + self.second(torch.relu(self.first(images))))


class Backbone(nn.Sequential):
    """Frozen layers: (N, H, W, 3 F) of 0..255, each picture of a stack alone -> (N, F width)."""

    def forward(self, images: torch.Tensor) -> torch.Tensor:
        """See the class."""
        pixels = centred(images).to(next(self.parameters()).dtype)
        seen = super().forward(pixels.reshape(-1, 3, *pixels.shape[2:]))
        return seen.reshape(-1, self.width * images.shape[3] // 3)

    @property
    def width(self) -> int:
        """How many numbers it says of a picture."""
        return cast(nn.Linear, self[-2]).out_features

    def apply(self, fn: Callable[[nn.Module], None]) -> Self:  # noqa: ARG002
        """Nothing: those who make all layers of a policy anew, such as SB3's, mean what learns."""
        return self


def read_backbone(path: Path) -> Backbone:
    """All layers of an ONNX sight but the last.

    ``path``: the sight, or a policy that has one for its backbone. ContractError for others.
    """
    remedy = "take a sight in FP32, or a policy that has one for its backbone"
    open_network(path, remedy)  # what is absent or damaged ends here
    graph = onnx.load(str(path)).graph
    values = {each.name: onnx.numpy_helper.to_array(each) for each in graph.initializer}
    nodes = [node for node in graph.node if node.op_type in ("Conv", "Gemm")][: len(_LAYERS)]
    layers = [[values[name] for name in node.input[1:] if name in values] for node in nodes]
    if [node.op_type for node in nodes] != _LAYERS or any(len(each) != 2 for each in layers):
        raise ContractError(f"{path}: expected the layers of a sight, got others; {remedy}")
    a, b, c, d, e, f, g, dense = (_layer(*each) for each in layers)
    body = (a, nn.ReLU(), b, nn.ReLU(), Twice(c, d), e, nn.ReLU(), Twice(f, g))
    return Backbone(*body, nn.Flatten(), dense, nn.ReLU()).requires_grad_(False)


def centred(images: torch.Tensor) -> torch.Tensor:
    """Pictures (N, H, W, 3) of 0..255 -> (N, 3, H, W) in -1..1, where they are in memory."""
    return fresh(images).div_(127.5).sub_(1.0)


def fresh(images: torch.Tensor) -> torch.Tensor:
    """Pictures (N, H, W, 3) -> (N, 3, H, W) float32 of their own, where they are in memory."""
    # permute alone leaves the pixels where they are: torch's "channels last", its fastest
    return images.to(torch.float32, copy=True).permute(0, 3, 1, 2)


class Seer:
    """What a backbone sees, computed once, for who learns from it many times.

    In bfloat16 where the processor has it: that differs by a hundredth.
    """

    def __init__(self, path: Path, device: str) -> None:
        self._device = get_device(device)
        kind = torch.bfloat16 if HALF or self._device.type != "cpu" else torch.float32
        self._network = read_backbone(path).to(self._device, kind)
        self.width = self._network.width

    @torch.no_grad()
    def __call__(self, images: np.ndarray | torch.Tensor) -> np.ndarray:
        """Stacks of pictures (..., H, W, 3 F) uint8 -> (..., F width) float32."""
        batch = torch.as_tensor(images, device=self._device).reshape(-1, *images.shape[-3:])
        return self._network(batch).float().cpu().numpy().reshape(*images.shape[:-3], -1)


def _layer(weight: np.ndarray, bias: np.ndarray) -> nn.Module:
    to, of, *size = weight.shape
    layer: nn.Conv2d | nn.Linear = nn.Linear(of, to)
    if size:
        layer = nn.Conv2d(of, to, size[0], 1 if of == to else 2, size[0] // 2)
    state = {"weight": weight, "bias": bias}
    layer.load_state_dict({name: torch.from_numpy(part.copy()) for name, part in state.items()})
    return layer
