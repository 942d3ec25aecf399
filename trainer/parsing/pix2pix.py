"""pix2pix (Isola et al. 2017) as paper B states it, and a small variant.

Pictures are (N, 3, H, W) float32 in [-1, 1], of any size: inside they are resized to the
configured one.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import torch
from torch import nn
from torch.nn import functional

from robot.contract import ImageSpec

MOST_WIDENING = 8  # times the first layer's channels
DROPPED = 3  # innermost enlargements whose dropout is the noise z


@dataclass(frozen=True)
class Pix2PixConfig:
    """Networks and weights of one translation."""

    height_px: int = 256  # inside the networks: a multiple of 2 ** halvings
    width_px: int = 256
    channels: int = 64  # of the first layer; doubled until `MOST_WIDENING`
    halvings: int = 8
    critic_layers: int = 3  # halvings of the PatchGAN; with 3 a patch is 70 px wide
    batch: int = 16
    learning_rate: float = 2e-4
    momentum: float = 0.5  # Adam's first
    l1: float = 100.0


PAPER = Pix2PixConfig()
SMALL = Pix2PixConfig(40, 80, 16, 3, 2, batch=8, learning_rate=1e-3)
PIX2PIX = {"paper": PAPER, "small": SMALL}


def fitted(config: Pix2PixConfig, image: ImageSpec) -> Pix2PixConfig:
    """The small networks at the pictures' own size, where they can be halved so often.

    Enlarging 40 rows to 48 blurs edges and leaves stripes. The paper's size stays the paper's.
    """
    height, width, _ = image.shape
    divisible = height % 2**config.halvings == width % 2**config.halvings == 0
    if config is PAPER or not divisible:
        return config
    return replace(config, height_px=height, width_px=width)


class UNet(nn.Module):
    """The generator: 4x4 convolutions of stride 2, all with batch normalisation, and skips."""

    def __init__(self, config: Pix2PixConfig) -> None:
        super().__init__()
        self.size = (config.height_px, config.width_px)
        widths = [config.channels * min(2**k, MOST_WIDENING) for k in range(config.halvings)]
        self.down = nn.ModuleList(
            _halving(a, b) for a, b in zip([3, *widths[:-1]], widths, strict=True)
        )
        up: list[nn.Module] = []
        for k in reversed(range(1, config.halvings)):
            below = widths[k] if k == config.halvings - 1 else 2 * widths[k]
            dropped = len(up) < DROPPED and config.halvings > DROPPED
            up.append(_doubling(below, widths[k - 1], dropped))
        self.up = nn.ModuleList(up)
        below = 2 * widths[0] if config.halvings > 1 else widths[0]
        self.last = nn.Sequential(nn.ConvTranspose2d(below, 3, 4, 2, 1), nn.Tanh())

    def forward(self, pictures: torch.Tensor) -> torch.Tensor:
        """The translation, as large as the picture."""
        x = _resized(pictures, self.size)
        skips = []
        for layer in self.down:
            x = layer(x)
            skips.append(x)
        skips.pop()
        for layer in self.up:
            x = torch.cat((layer(x), skips.pop()), dim=1)
        return _resized(self.last(x), (pictures.shape[2], pictures.shape[3]))


class PatchCritic(nn.Module):
    """PatchGAN: logits (N, 1, h, w) that patches of a translation belong to the picture given."""

    def __init__(self, config: Pix2PixConfig) -> None:
        super().__init__()
        width = config.channels
        layers: list[nn.Module] = [nn.Conv2d(6, width, 4, 2, 1), nn.LeakyReLU(0.2)]
        for k in range(config.critic_layers):
            stride = 2 if k < config.critic_layers - 1 else 1
            wider = min(2 * width, MOST_WIDENING * config.channels)
            layers += [
                nn.Conv2d(width, wider, 4, stride, 1, bias=False),
                nn.BatchNorm2d(wider),
                nn.LeakyReLU(0.2),
            ]
            width = wider
        self.layers = nn.Sequential(*layers, nn.Conv2d(width, 1, 4, 1, 1))
        self.size = (config.height_px, config.width_px)

    def forward(self, given: torch.Tensor, translation: torch.Tensor) -> torch.Tensor:
        """See the class."""
        pair = (_resized(given, self.size), _resized(translation, self.size))
        return self.layers(torch.cat(pair, dim=1))


class Pix2Pix:
    """Generator, critic and their optimisers: one step at a time."""

    def __init__(self, config: Pix2PixConfig, seed: int) -> None:
        torch.manual_seed(seed)
        self.config = config
        self.generator, self.critic = (
            UNet(config).apply(_normal),
            PatchCritic(config).apply(_normal),
        )
        rate, betas = config.learning_rate, (config.momentum, 0.999)
        self.of_generator = torch.optim.Adam(self.generator.parameters(), rate, betas)
        self.of_critic = torch.optim.Adam(self.critic.parameters(), rate, betas)

    def step(self, given: torch.Tensor, wanted: torch.Tensor) -> float:
        """Teach both on pairs (N, 3, H, W); the L1 distance that was left, in [-1, 1]."""
        made = self.generator.train()(given)
        real, fake = self.critic(given, wanted), self.critic(given, made.detach())
        _descend(self.of_critic, 0.5 * (_belongs(real, 1.0) + _belongs(fake, 0.0)))
        distance = functional.l1_loss(made, wanted)
        fooled = _belongs(self.critic(given, made), 1.0)
        _descend(self.of_generator, fooled + self.config.l1 * distance)
        return float(distance.detach())


def _descend(optimiser: torch.optim.Optimizer, loss: torch.Tensor) -> None:
    optimiser.zero_grad()
    loss.backward()
    optimiser.step()


def _belongs(logits: torch.Tensor, truth: float) -> torch.Tensor:
    target = torch.full_like(logits, truth)
    return functional.binary_cross_entropy_with_logits(logits, target)


def _halving(inputs: int, outputs: int) -> nn.Sequential:
    return nn.Sequential(
        nn.Conv2d(inputs, outputs, 4, 2, 1, bias=False), nn.BatchNorm2d(outputs), nn.LeakyReLU(0.2)
    )


def _doubling(inputs: int, outputs: int, dropped: bool) -> nn.Sequential:
    layers = [
        nn.ConvTranspose2d(inputs, outputs, 4, 2, 1, bias=False),
        nn.BatchNorm2d(outputs),
        *([nn.Dropout()] if dropped else []),
        nn.ReLU(),
    ]
    return nn.Sequential(*layers)


def _resized(pictures: torch.Tensor, size: tuple[int, int]) -> torch.Tensor:
    if pictures.shape[2:] == size:
        return pictures
    return functional.interpolate(pictures, size, mode="bilinear", align_corners=False)


def _normal(module: nn.Module) -> None:
    """Isola et al.: weights from N(0, 0.02)."""
    if isinstance(module, (nn.Conv2d, nn.ConvTranspose2d)):
        nn.init.normal_(module.weight, 0.0, 0.02)
    elif isinstance(module, nn.BatchNorm2d):
        nn.init.normal_(module.weight, 1.0, 0.02)
