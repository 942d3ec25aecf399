"""SegNet (Badrinarayanan, Kendall, Cipolla 2017): the network of a parser."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import torch
from torch import nn

from trainer.transfer.networks import as_floats

# Channels of SegNet's stages, and how many convolutions each has.
SEGNETS = {
    "small": ((16, 32, 64, 64), (1, 1, 2, 2)),
    # VGG16's thirteen convolutions, as the paper has them
    "paper": ((64, 128, 256, 512, 512), (2, 2, 3, 3, 3)),
}


class SegNet(nn.Module):
    """A decoder undoes each pooling of an encoder by its indices.

    Encoder stages are convolution, batch normalisation, ReLU, then 2x2 max pooling that remembers
    where each maximum was; a decoder stage puts its values back there and convolves again.
    Pictures (N, H, W, 3) with values 0..255 -> logits (N, classes, H, W), any H and W.
    """

    def __init__(self, classes: int, channels: Sequence[int], convolutions: Sequence[int]) -> None:
        super().__init__()
        encoder, decoder = [], []
        below = 3
        for width, count in zip(channels, convolutions, strict=True):
            encoder.append(_stage(below, width, width, count))
            # the first stage's decoder leaves its width: the classes come after it
            decoder.append(_stage(width, width, width if below == 3 else below, count))
            below = width
        self.encoder = nn.ModuleList(encoder)
        self.decoder = nn.ModuleList(reversed(decoder))
        self.pool = nn.MaxPool2d(2, return_indices=True)
        self.classify = nn.Conv2d(channels[0], classes, 3, padding="same")

    def forward(self, pictures: torch.Tensor) -> torch.Tensor:
        """See the class."""
        x = as_floats(pictures)
        pooled: list[tuple[torch.Tensor, torch.Size]] = []
        for stage in self.encoder:
            x = stage(x)
            size = x.shape
            x, indices = self.pool(x)
            pooled.append((indices, size))
        for stage in self.decoder:
            indices, size = pooled.pop()
            x = stage(unpooled(x, indices, size))
        logits: torch.Tensor = self.classify(x)
        return logits


def unpooled(x: torch.Tensor, indices: torch.Tensor, size: torch.Size) -> torch.Tensor:
    """Values (N, C, h, w) put back where their maxima were, zeros elsewhere: (N, C, *size[2:]).

    As `torch.nn.MaxUnpool2d`, which ONNX has no operator for.
    """
    # with new_zeros and unflatten the exporter would fix the number of pictures
    count, channels = x.shape[:2]
    empty = torch.zeros(count, channels, size[2] * size[3], dtype=x.dtype, device=x.device)
    filled = empty.scatter(2, indices.flatten(2), x.flatten(2))
    return filled.view(count, channels, size[2], size[3])


def _stage(inputs: int, width: int, outputs: int, count: int) -> nn.Sequential:
    widths, layers = [inputs, *[width] * (count - 1), outputs], list[nn.Module]()
    for a, b in pairwise(widths):
        # batch normalisation brings its own offset
        layers += [nn.Conv2d(a, b, 3, padding="same", bias=False), nn.BatchNorm2d(b), nn.ReLU()]
    return nn.Sequential(*layers)
