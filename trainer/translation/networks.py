"""Generators and critics. Pictures are (N, 3, H, W) float32 in [-1, 1].

Both generators begin as the identity: their last layer, which starts at zero, says what to add to
the picture. Nothing has to be learned to keep a line where it is.
"""

from __future__ import annotations

import torch
from torch import nn
from torch.nn import functional

from trainer.translation.config import TranslationConfig

_LEAK = 0.1  # slope beyond black and white, so that gradients come back from there


class UNet(nn.Module):
    """Three halvings and back, with skips (Ronneberger et al. 2015), kept narrow.

    Enlarging is by nearest neighbours before a convolution: transposed convolutions leave chequers
    (Odena et al. 2016), and so did pixel shuffling in a first training.
    """

    def __init__(self, width: int, blocks: int) -> None:
        super().__init__()
        w = width
        self.down1 = nn.Conv2d(3, w, 4, 2, 1)
        self.down2 = _halving(w, 2 * w)
        self.down3 = _halving(2 * w, 4 * w)
        self.deep = nn.Sequential(*(_Residual(4 * w) for _ in range(blocks)))
        self.up3 = _same(4 * w, 2 * w)
        self.up2 = _same(4 * w, w)
        self.up1 = nn.Sequential(nn.ReLU(), nn.Conv2d(2 * w, w // 2, 3, 1, 1))
        self.last = _zero(nn.Conv2d(w // 2 + 3, 3, 3, 1, 1))

    def forward(self, pictures: torch.Tensor) -> torch.Tensor:
        """The translation."""
        half = self.down1(pictures)
        quarter = self.down2(half)
        eighth = self.deep(self.down3(quarter))
        up = _enlarged(self.up3(eighth), quarter)
        up = _enlarged(self.up2(torch.cat((up, quarter), 1)), half)
        up = _enlarged(self.up1(torch.cat((up, half), 1)), pictures)
        return _changed(pictures, self.last(torch.cat((up, pictures), 1)))


class ResNet(nn.Module):
    """Two halvings, residual blocks and back (Johnson et al. 2016), as CycleGAN has it."""

    def __init__(self, width: int, blocks: int) -> None:
        super().__init__()
        w = width
        self.inner = nn.Sequential(
            nn.Conv2d(3, w, 7, 1, 3),
            _halving(w, 2 * w),
            _halving(2 * w, 4 * w),
            *(_Residual(4 * w) for _ in range(blocks)),
            nn.Upsample(scale_factor=2.0),
            _same(4 * w, 2 * w),
            nn.Upsample(scale_factor=2.0),
            _same(2 * w, w),
            nn.ReLU(),
        )
        self.last = _zero(nn.Conv2d(w, 3, 7, 1, 3))

    def forward(self, pictures: torch.Tensor) -> torch.Tensor:
        """The translation."""
        return _changed(pictures, self.last(_cut(self.inner(pictures), pictures)))


class PatchCritic(nn.Module):
    """Scores of overlapping patches (N, 1, h, w): 1 is real, 0 is made (Isola et al. 2017)."""

    def __init__(self, width: int, layers: int) -> None:
        super().__init__()
        stack: list[nn.Module] = [nn.Conv2d(3, width, 4, 2, 1), nn.LeakyReLU(0.2)]
        for k in range(1, layers + 1):
            stride = 2 if k < layers else 1
            stack += [
                nn.Conv2d(width, 2 * width, 4, stride, 1, bias=False),
                nn.InstanceNorm2d(2 * width),
                nn.LeakyReLU(0.2),
            ]
            width *= 2
        self.stack = nn.Sequential(*stack, nn.Conv2d(width, 1, 4, 1, 1))

    def forward(self, pictures: torch.Tensor) -> torch.Tensor:
        """The scores."""
        scores: torch.Tensor = self.stack(pictures)
        return scores


class PictureTranslator(nn.Module):
    """A generator between pictures as the policy has them; what is exported."""

    def __init__(self, generator: nn.Module) -> None:
        super().__init__()
        self.generator = generator

    def forward(self, image: torch.Tensor) -> torch.Tensor:
        """(N, H, W, 3) uint8 RGB -> (N, H, W, 3) uint8 RGB."""
        return as_bytes(self.generator(as_floats(image)))


def build_generator(config: TranslationConfig) -> nn.Module:
    """The configured generator, identical to the identity."""
    kinds = {"unet": UNet, "resnet": ResNet}
    return kinds[config.generator](config.width, config.blocks)


def as_floats(pictures: torch.Tensor) -> torch.Tensor:
    """(N, H, W, 3) uint8 -> (N, 3, H, W) float32 in [-1, 1]."""
    return pictures.permute(0, 3, 1, 2).float() / 127.5 - 1.0


def as_bytes(pictures: torch.Tensor) -> torch.Tensor:
    """(N, 3, H, W) float32 -> (N, H, W, 3) uint8, cut off at black and white."""
    scaled = ((pictures + 1.0) * 127.5 + 0.5).clamp(0.0, 255.0)
    return scaled.to(torch.uint8).permute(0, 2, 3, 1)


def _halving(before: int, after: int) -> nn.Sequential:
    return nn.Sequential(
        nn.LeakyReLU(0.2),
        nn.Conv2d(before, after, 4, 2, 1, bias=False),
        nn.InstanceNorm2d(after, affine=True),
    )


def _same(before: int, after: int) -> nn.Sequential:
    return nn.Sequential(
        nn.ReLU(),
        nn.Conv2d(before, after, 3, 1, 1, bias=False),
        nn.InstanceNorm2d(after, affine=True),
    )


class _Residual(nn.Module):
    def __init__(self, width: int) -> None:
        super().__init__()
        self.inner = nn.Sequential(_same(width, width), _same(width, width))

    def forward(self, features: torch.Tensor) -> torch.Tensor:
        return features + self.inner(features)


def _zero(layer: nn.Conv2d) -> nn.Conv2d:
    nn.init.zeros_(layer.weight)
    if layer.bias is not None:
        nn.init.zeros_(layer.bias)
    return layer


def _enlarged(features: torch.Tensor, like: torch.Tensor) -> torch.Tensor:
    return functional.interpolate(features, size=like.shape[2:])


def _cut(features: torch.Tensor, like: torch.Tensor) -> torch.Tensor:
    if features.shape[2:] == like.shape[2:]:
        return features
    return functional.interpolate(features, size=like.shape[2:])


def _changed(pictures: torch.Tensor, change: torch.Tensor) -> torch.Tensor:
    changed = pictures + 2.0 * torch.tanh(change)
    cut = changed.clamp(-1.0, 1.0)
    return cut + _LEAK * (changed - cut)
