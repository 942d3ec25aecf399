"""The networks: the U-Nets of CycleGAN and of pix2pix, a critic of patches, and SegNet.

Inside them pictures are (N, 3, H, W) float32 in [-1, 1]. A translator's own pictures are
(N, H, W, 3) uint8 RGB on both sides, see `PictureTranslator`.
"""

from collections.abc import Callable, Sequence
from itertools import pairwise

import numpy as np
import torch
from torch import nn
from torch.nn import functional

from trainer.learners.backbone import centred

_LEAK = 0.1  # slope beyond black and white, so that gradients come back from there
MOST_WIDENING = 8  # times the first layer's channels, of pix2pix and of critics
DROPPED = 3  # of pix2pix: innermost enlargements whose dropout is the noise z

# Channels of SegNet's stages, and how many convolutions each has.
SEGNETS = {
    "small": ((16, 32, 64, 64), (1, 1, 2, 2)),
    # VGG16's thirteen convolutions, as the paper has them
    "paper": ((64, 128, 256, 512, 512), (2, 2, 3, 3, 3)),
}


def as_bytes(pictures: torch.Tensor) -> torch.Tensor:
    """(N, 3, H, W) float32 -> (N, H, W, 3) uint8, cut off at black and white."""
    return ((pictures + 1.0) * 127.5 + 0.5).clamp(0.0, 255.0).to(torch.uint8).permute(0, 2, 3, 1)


@torch.no_grad()
def through(
    network: Callable[[torch.Tensor], torch.Tensor],
    pictures: np.ndarray,
    device: torch.device | str = "cpu",
    size: int = 32,
) -> np.ndarray:
    """What a network makes of many pictures (N, H, W, 3) uint8, ``size`` of them at once."""
    parts = [np.ascontiguousarray(pictures[k : k + size]) for k in range(0, len(pictures), size)]
    return np.concatenate([network(torch.from_numpy(p).to(device)).cpu().numpy() for p in parts])


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
        seen = torch.where(scores[:, k : k + 1] > best, colours[k].view(1, 3, 1, 1), seen)
        best = torch.maximum(best, scores[:, k : k + 1])
    return seen


class PictureTranslator(nn.Module):
    """A generator between pictures as the policy has them; what is exported."""

    def __init__(self, generator: nn.Module) -> None:
        super().__init__()
        self.generator = generator

    def forward(self, image: torch.Tensor) -> torch.Tensor:
        """(N, H, W, 3) uint8 RGB -> (N, H, W, 3) uint8 RGB."""
        return as_bytes(self.generator(centred(image)))


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
        return self.last(x)


class Changing(nn.Module):
    """Adds to a picture what the inner network says.

    Where that network's last layer starts at zero, the whole starts as the identity: nothing has to
    be learned to keep a line where it is.
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
    """A network that sees pictures of one size (H, W), or of their own; between pictures of any."""

    def __init__(self, inner: nn.Module, size: tuple[int, int] | None) -> None:
        super().__init__()
        self.inner, self.size = inner, size

    def forward(self, pictures: torch.Tensor) -> torch.Tensor:
        """The translation, as large as the picture."""
        made = self.inner(resized(pictures, self.size or pictures.shape[2:], "bilinear"))
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
    last = nn.Conv2d(w // 2 + 3, 3, 3, 1, 1)
    for parameter in last.parameters():
        nn.init.zeros_(parameter)
    return Changing(UNet(down, deep, up, last))


def paper_unet(size: tuple[int, int] | None, channels: int, halvings: int) -> nn.Module:
    """The generator of pix2pix: 4x4 convolutions of stride 2, batch normalisation (Isola et al.).

    Inside it pictures have ``size`` (H, W), if one is given; the channels of the first layer are
    doubled until `MOST_WIDENING`.
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
        stack += [nn.Conv2d(width, wider, 4, stride, 1, bias=False), norm(wider), nn.LeakyReLU(0.2)]
        width = wider
    return nn.Sequential(*stack, nn.Conv2d(width, 1, 4, 1, 1))


class SegNet(nn.Module):
    """A decoder undoes each pooling of an encoder by its indices.

    Encoder stages are convolution, batch normalisation, ReLU, then 2x2 max pooling that remembers
    where each maximum was; a decoder stage puts its values back there and convolves again
    (Badrinarayanan, Kendall, Cipolla 2017).
    Pictures (N, H, W, 3) with values 0..255 -> logits (N, classes, H, W), any H and W.
    """

    def __init__(self, classes: int, channels: Sequence[int], convolutions: Sequence[int]) -> None:
        super().__init__()
        self.encoder, self.decoder, below = nn.ModuleList(), nn.ModuleList(), 3
        for width, count in zip(channels, convolutions, strict=True):
            self.encoder.append(_stage(below, width, width, count))
            # the first stage's decoder leaves its width: the classes come after it
            self.decoder.insert(0, _stage(width, width, width if below == 3 else below, count))
            below = width
        self.pool = nn.MaxPool2d(2, return_indices=True)
        self.classify = nn.Conv2d(channels[0], classes, 3, padding="same")

    def forward(self, pictures: torch.Tensor) -> torch.Tensor:
        """See the class."""
        x = centred(pictures)
        pooled: list[tuple[torch.Tensor, torch.Size]] = []
        for stage in self.encoder:
            whole = stage(x)
            x, indices = self.pool(whole)
            pooled.append((indices, whole.shape))
        for stage in self.decoder:
            x = stage(unpooled(x, *pooled.pop()))
        return self.classify(x)


def unpooled(x: torch.Tensor, indices: torch.Tensor, size: torch.Size) -> torch.Tensor:
    """As `torch.nn.MaxUnpool2d`, which ONNX lacks: (N, C, h, w), indices to (N, C, *size[2:])."""
    # with new_zeros and unflatten the exporter would fix the number of pictures
    count, channels = x.shape[:2]
    empty = torch.zeros(count, channels, size[2] * size[3], dtype=x.dtype, device=x.device)
    filled = empty.scatter(2, indices.flatten(2), x.flatten(2))
    return filled.view(count, channels, size[2], size[3])


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


def _stage(inputs: int, width: int, outputs: int, count: int) -> nn.Sequential:
    widths, layers = [inputs, *[width] * (count - 1), outputs], list[nn.Module]()
    for a, b in pairwise(widths):
        # batch normalisation brings its own offset
        layers += [nn.Conv2d(a, b, 3, padding="same", bias=False), nn.BatchNorm2d(b), nn.ReLU()]
    return nn.Sequential(*layers)
