"""The networks: the U-Net of CycleGAN and that of pix2pix, and a critic of patches.

Inside them pictures are (N, 3, H, W) float32 in [-1, 1]. A translator's own pictures are
(N, H, W, 3) uint8 RGB on both sides, see `PictureTranslator`.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import torch
from torch import nn
from torch.nn import functional

_LEAK = 0.1  # slope beyond black and white, so that gradients come back from there
MOST_WIDENING = 8  # times the first layer's channels, of pix2pix and of critics
DROPPED = 3  # of pix2pix: innermost enlargements whose dropout is the noise z


def as_floats(pictures: torch.Tensor) -> torch.Tensor:
    """(N, H, W, 3) uint8 -> (N, 3, H, W) float32 in [-1, 1]."""
    return pictures.permute(0, 3, 1, 2).float() / 127.5 - 1.0


def as_bytes(pictures: torch.Tensor) -> torch.Tensor:
    """(N, 3, H, W) float32 -> (N, H, W, 3) uint8, cut off at black and white."""
    scaled = ((pictures + 1.0) * 127.5 + 0.5).clamp(0.0, 255.0)
    return scaled.to(torch.uint8).permute(0, 2, 3, 1)


def resized(pictures: torch.Tensor, size: Sequence[int], mode: str = "nearest") -> torch.Tensor:
    """(N, C, H, W) -> (N, C, *size)."""
    same = tuple(pictures.shape[2:]) == tuple(size)
    return pictures if same else functional.interpolate(pictures, tuple(size), mode=mode)


def painted(scores: torch.Tensor, colours: torch.Tensor) -> torch.Tensor:
    """Scores (N, C, H, W) and colours (C, 3) -> (N, 3, H, W), each pixel its best class's colour.

    By comparing class after class: argmax and indexing take onnxruntime twice as long as a whole
    generator.
    """
    best, seen = scores[:, :1], colours[0].view(1, 3, 1, 1)
    for k in range(1, len(colours)):
        better = scores[:, k : k + 1] > best
        seen = torch.where(better, colours[k].view(1, 3, 1, 1), seen)
        best = torch.maximum(best, scores[:, k : k + 1])
    return seen


class PictureTranslator(nn.Module):
    """A generator between pictures as the policy has them; what is exported."""

    def __init__(self, generator: nn.Module) -> None:
        super().__init__()
        self.generator = generator

    def forward(self, image: torch.Tensor) -> torch.Tensor:
        """(N, H, W, 3) uint8 RGB -> (N, H, W, 3) uint8 RGB."""
        return as_bytes(self.generator(as_floats(image)))


class UNet(nn.Module):
    """Halvings ``down``, ``deep`` at the narrowest place, and ``up`` again with skips.

    Ronneberger et al. 2015. Beside what each layer of ``up`` gives, enlarged where it has to be,
    goes what the halving that it undoes was given; ``last`` gives the picture.
    """

    def __init__(
        self, down: Sequence[nn.Module], deep: nn.Module, up: Sequence[nn.Module], last: nn.Module
    ) -> None:
        super().__init__()
        self.down, self.deep = nn.ModuleList(down), deep
        self.up, self.last = nn.ModuleList(up), last

    def forward(self, pictures: torch.Tensor) -> torch.Tensor:
        """The translation."""
        x, skips = pictures, []
        for layer in self.down:
            skips.append(x)
            x = layer(x)
        x = self.deep(x)
        for layer in self.up:
            skip = skips.pop()
            x = torch.cat((resized(layer(x), skip.shape[2:]), skip), 1)
        made: torch.Tensor = self.last(x)
        return made


class Changing(nn.Module):
    """Adds to a picture what the inner network says.

    That network's last layer starts at zero (`_zero`), so the whole starts as the identity: nothing
    has to be learned to keep a line where it is.
    """

    def __init__(self, inner: nn.Module) -> None:
        super().__init__()
        self.inner = inner

    def forward(self, pictures: torch.Tensor) -> torch.Tensor:
        """The translation."""
        change = resized(self.inner(pictures), pictures.shape[2:])  # halved, an odd size has grown
        changed = pictures + 2.0 * torch.tanh(change)
        cut = changed.clamp(-1.0, 1.0)
        return cut + _LEAK * (changed - cut)


class AtSize(nn.Module):
    """A network that sees pictures of one size (H, W), between pictures of any."""

    def __init__(self, inner: nn.Module, size: tuple[int, int]) -> None:
        super().__init__()
        self.inner, self.size = inner, size

    def forward(self, pictures: torch.Tensor) -> torch.Tensor:
        """The translation, as large as the picture."""
        made = self.inner(resized(pictures, self.size, "bilinear"))
        return resized(made, pictures.shape[2:], "bilinear")


def narrow_unet(width: int, blocks: int) -> nn.Module:
    """CycleGAN's U-Net for small pictures: three halvings, instance normalisation.

    Enlarging is by nearest neighbours before a convolution: transposed convolutions leave chequers
    (Odena et al. 2016), and so did pixel shuffling in a first training.
    """
    w = width
    down = [nn.Conv2d(3, w, 4, 2, 1), _halving(w, 2 * w), _halving(2 * w, 4 * w)]
    deep = nn.Sequential(*(_Residual(4 * w) for _ in range(blocks)))
    up = [_same(4 * w, 2 * w), _same(4 * w, w)]
    up.append(nn.Sequential(nn.ReLU(), nn.Conv2d(2 * w, w // 2, 3, 1, 1)))
    return Changing(UNet(down, deep, up, _zero(nn.Conv2d(w // 2 + 3, 3, 3, 1, 1))))


def pix2pix_unet(size: tuple[int, int], channels: int, halvings: int) -> nn.Module:
    """The generator of pix2pix: 4x4 convolutions of stride 2, batch normalisation (Isola et al.).

    Inside it pictures have ``size`` (H, W), which can be halved so often; the channels of the first
    layer are doubled until `MOST_WIDENING`.
    """
    widths = [channels * min(2**k, MOST_WIDENING) for k in range(halvings)]
    down = [
        nn.Sequential(nn.Conv2d(a, b, 4, 2, 1, bias=False), nn.BatchNorm2d(b), nn.LeakyReLU(0.2))
        for a, b in zip([3, *widths[:-1]], widths, strict=True)
    ]
    up: list[nn.Module] = []
    for k in reversed(range(1, halvings)):
        below = widths[k] if k == halvings - 1 else 2 * widths[k]
        dropped = [nn.Dropout()] if len(up) < DROPPED and halvings > DROPPED else []
        enlarging = nn.ConvTranspose2d(below, widths[k - 1], 4, 2, 1, bias=False)
        up.append(nn.Sequential(enlarging, nn.BatchNorm2d(widths[k - 1]), *dropped, nn.ReLU()))
    last = nn.Sequential(nn.ConvTranspose2d(2 * widths[0], 3, 4, 2, 1), nn.Tanh())
    return AtSize(UNet(down, nn.Identity(), up, last), size)


def patch_critic(
    width: int, layers: int, inputs: int = 3, norm: Callable[[int], nn.Module] = nn.InstanceNorm2d
) -> nn.Module:
    """PatchGAN: pictures -> scores of overlapping patches (N, 1, h, w) (Isola et al. 2017).

    ``width``: channels of the first layer; ``layers`` halve: with 2 a patch is 34 px wide, with 3
    it is 70. ``inputs``: channels of what it judges.
    """
    stack: list[nn.Module] = [nn.Conv2d(inputs, width, 4, 2, 1), nn.LeakyReLU(0.2)]
    widest = MOST_WIDENING * width
    for k in range(1, layers + 1):
        wider, stride = min(2 * width, widest), 2 if k < layers else 1
        convolution = nn.Conv2d(width, wider, 4, stride, 1, bias=False)
        stack += [convolution, norm(wider), nn.LeakyReLU(0.2)]
        width = wider
    return nn.Sequential(*stack, nn.Conv2d(width, 1, 4, 1, 1))


def _halving(before: int, after: int) -> nn.Sequential:
    convolution = nn.Conv2d(before, after, 4, 2, 1, bias=False)
    return nn.Sequential(nn.LeakyReLU(0.2), convolution, nn.InstanceNorm2d(after, affine=True))


def _same(before: int, after: int) -> nn.Sequential:
    convolution = nn.Conv2d(before, after, 3, 1, 1, bias=False)
    return nn.Sequential(nn.ReLU(), convolution, nn.InstanceNorm2d(after, affine=True))


class _Residual(nn.Module):
    def __init__(self, width: int) -> None:
        super().__init__()
        self.inner = nn.Sequential(_same(width, width), _same(width, width))

    def forward(self, features: torch.Tensor) -> torch.Tensor:
        return features + self.inner(features)


def _zero(layer: nn.Conv2d) -> nn.Conv2d:
    for parameter in layer.parameters():
        nn.init.zeros_(parameter)
    return layer
