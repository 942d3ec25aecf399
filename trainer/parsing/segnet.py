"""SegNet (Badrinarayanan, Kendall, Cipolla 2017): the decoder undoes each pooling by its indices.

Encoder stages are convolution, batch normalisation, ReLU, then 2x2 max pooling that remembers
where each maximum was; a decoder stage puts its values back there and convolves again.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import nn


@dataclass(frozen=True)
class SegNetConfig:
    """Channels of each stage, and how many convolutions it has."""

    channels: tuple[int, ...] = (16, 32, 64, 64)
    convolutions: tuple[int, ...] = (1, 1, 2, 2)
    kernel: int = 3


SMALL = SegNetConfig()
# VGG16's thirteen convolutions, as the paper has them.
PAPER = SegNetConfig((64, 128, 256, 512, 512), (2, 2, 3, 3, 3))
SEGNETS = {"small": SMALL, "paper": PAPER}


class SegNet(nn.Module):
    """Pictures (N, H, W, 3) with values 0..255 -> logits (N, classes, H, W), any H and W."""

    def __init__(self, classes: int, config: SegNetConfig = SMALL) -> None:
        super().__init__()
        encoder, decoder = [], []
        below = 3
        for width, count in zip(config.channels, config.convolutions, strict=True):
            encoder.append(_stage(below, width, width, count, config.kernel))
            # the first stage's decoder leaves its width: the classes come after it
            out = width if below == 3 else below
            decoder.append(_stage(width, width, out, count, config.kernel))
            below = width
        self.encoder = nn.ModuleList(encoder)
        self.decoder = nn.ModuleList(reversed(decoder))
        self.pool = nn.MaxPool2d(2, return_indices=True)
        self.classify = nn.Conv2d(config.channels[0], classes, config.kernel, padding="same")

    def forward(self, pictures: torch.Tensor) -> torch.Tensor:
        """See the class."""
        x = pictures.permute(0, 3, 1, 2).float() / 127.5 - 1.0
        pooled: list[tuple[torch.Tensor, torch.Size]] = []
        for stage in self.encoder:
            x = stage(x)
            size = x.shape
            x, indices = self.pool(x)
            pooled.append((indices, size))
        for stage in self.decoder:
            indices, size = pooled.pop()
            x = stage(unpooled(x, indices, size))
        return self.classify(x)


def unpooled(x: torch.Tensor, indices: torch.Tensor, size: torch.Size) -> torch.Tensor:
    """Values (N, C, h, w) put back where their maxima were, zeros elsewhere: (N, C, *size[2:]).

    As `torch.nn.MaxUnpool2d`, which ONNX has no operator for.
    """
    # with new_zeros and unflatten the exporter would fix the number of pictures
    count, channels = x.shape[:2]
    empty = torch.zeros(count, channels, size[2] * size[3], dtype=x.dtype, device=x.device)
    filled = empty.scatter(2, indices.flatten(2), x.flatten(2))
    return filled.view(count, channels, size[2], size[3])


def _stage(inputs: int, width: int, outputs: int, count: int, kernel: int) -> nn.Sequential:
    layers: list[nn.Module] = []
    for i in range(count):
        source = inputs if i == 0 else width
        target = outputs if i == count - 1 else width
        # batch normalisation brings its own offset
        layers += [
            nn.Conv2d(source, target, kernel, padding="same", bias=False),
            nn.BatchNorm2d(target),
            nn.ReLU(),
        ]
    return nn.Sequential(*layers)
