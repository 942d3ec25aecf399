"""What translations are measured by: the distance between sets of pictures, and lines found.

KID is told from features that need no download: those of a fixed network of random filters, three
convolutions drawn from seed 0, each followed by rectification and halving, averaged over a grid of
2 x 2 cells at every depth, and standardised by the set compared with. A deviation there counts for
no less than one grey level: in a set whose skies are all alike some features hardly deviate.

Untrained filters answer to colour, contrast, sharpness, noise and oriented texture, and hardly to
what things are. Figures compare with others of the same folders and picture size only.
"""

from __future__ import annotations

from collections.abc import Callable

import cv2
import numpy as np
import torch
from torch import nn

from trainer.transfer.networks import as_floats

_CHANNELS = (16, 24, 32)
_SPLITS = 40
_SPLIT = 50
_GREY_LEVEL = 2.0 / 255.0  # of pictures as the networks get them, -1 .. 1
_FLOOR_SHARE = 0.98  # of a pixel that must be white or yellow paint, or road
_LEAST_CONTRAST = 25.0  # grey levels between paint and road, below which nothing is a line


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


def features(pictures: np.ndarray) -> np.ndarray:
    """(N, 2 * 4 * 72) float64 of pictures (N, H, W, 3) uint8: means and deviations of each cell."""
    layers = _network()

    def of_some(some: torch.Tensor) -> torch.Tensor:
        maps, parts = as_floats(some), []
        for layer in layers:
            maps = layer(maps)
            mean = nn.functional.adaptive_avg_pool2d(maps, 2)
            square = nn.functional.adaptive_avg_pool2d(maps * maps, 2)
            parts += [mean.flatten(1), (square - mean**2).clamp_min(0).sqrt().flatten(1)]
            maps = nn.functional.avg_pool2d(maps, 2)
        return torch.cat(parts, 1).double()

    return through(of_some, pictures, size=64)


def kernel_distance(made: np.ndarray, real: np.ndarray, seed: int = 0) -> float:
    """KID (Binkowski et al. 2018): unbiased squared MMD of a cubic kernel, over splits of 50.

    ``made`` are features (N, D), ``real`` (M, D), by which both are standardised.
    """
    made, real = _standardised(made, real)
    rng, distances = np.random.default_rng(seed), []
    for _ in range(_SPLITS):
        a = made[rng.choice(len(made), min(_SPLIT, len(made)), replace=False)]
        b = real[rng.choice(len(real), min(_SPLIT, len(real)), replace=False)]
        n, m = len(a), len(b)
        within_a, within_b = _kernel(a, a), _kernel(b, b)
        distances.append(
            (within_a.sum() - np.trace(within_a)) / (n * (n - 1))
            + (within_b.sum() - np.trace(within_b)) / (m * (m - 1))
            - 2.0 * _kernel(a, b).mean()
        )
    return float(np.mean(distances))


def bright_lines(pictures: np.ndarray, paint: np.ndarray) -> np.ndarray:
    """(N, H, W) uint8, 1 on lines, told by brightness alone: a judge that learned nothing.

    On the floor that the simulator says is in sight there are two kinds of pixels, bright paint and
    dark road. Otsu's threshold (1979) parts them in each picture, on red and green: blue is what
    casts take away. ``paint`` (N, 4, H, W), as of `load_paint`, says only where to look.
    """
    masks = np.zeros(pictures.shape[:3], np.uint8)
    shares = paint.astype(np.float32) / 255.0
    floors = shares[:, 0] + shares[:, 1] + shares[:, 3] >= _FLOOR_SHARE
    brightness = pictures[..., :2].mean(-1)
    for mask, light, floor in zip(masks, brightness, floors, strict=True):
        seen = np.round(light[floor]).astype(np.uint8)
        if not len(seen):
            continue
        level, _ = cv2.threshold(seen, 0, 255, cv2.THRESH_BINARY + cv2.THRESH_OTSU)
        bright = seen > level
        both = bright.any() and not bright.all()
        if both and seen[bright].mean() - seen[~bright].mean() > _LEAST_CONTRAST:
            mask[floor] = light[floor] > level
    return masks


def overlap(found: np.ndarray, expected: np.ndarray) -> float:
    """Intersection over union of all line pixels of masks (N, H, W), whatever their colour."""
    both = ((found > 0) & (expected > 0)).sum()
    either = ((found > 0) | (expected > 0)).sum()
    return float(both / either) if either else 1.0


def _network() -> list[nn.Module]:
    generator = torch.Generator().manual_seed(0)
    layers: list[nn.Module] = []
    before = 3
    for after in _CHANNELS:
        conv = nn.Conv2d(before, after, 3, 1, 1)
        with torch.no_grad():
            conv.weight.normal_(0.0, (2.0 / (9 * before)) ** 0.5, generator=generator)
            conv.bias.normal_(0.0, 0.1, generator=generator)  # type: ignore[union-attr]
        layers.append(nn.Sequential(conv, nn.ReLU()))
        before = after
    return layers


def _standardised(made: np.ndarray, real: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    mean, deviation = real.mean(0), np.hypot(real.std(0), _GREY_LEVEL)
    return (made - mean) / deviation, (real - mean) / deviation


def _kernel(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return np.asarray((a @ b.T / a.shape[1] + 1.0) ** 3)
