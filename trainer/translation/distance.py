"""How far two sets of pictures are apart, by features that need no download.

The features are those of a fixed network of random filters: three convolutions drawn from seed 0,
each followed by rectification and halving, averaged over a grid of 2 x 2 cells at every depth, and
standardised by the set compared with. A deviation there counts for no less than one grey level:
pictures are rounded to that, and the filters keep the scale of what they get (He et al. 2015). In a
set whose skies are all alike, without texture, some features hardly deviate, and whatever differs
from them would be infinitely far away.

Untrained filters answer to colour, contrast, sharpness, noise and oriented texture, and hardly to
what things are: a distance that falls says that pictures have come closer in these. Figures compare
with others of the same folders and picture size only, and with nothing published, which uses
Inception features.
"""

from __future__ import annotations

import numpy as np
import torch
from torch import nn

from trainer.translation.networks import as_floats

_CHANNELS = (16, 24, 32)
_BATCH = 64
_SPLITS = 40
_SPLIT = 50
_GREY_LEVEL = 2.0 / 255.0  # of pictures as the networks get them, -1 .. 1


def features(pictures: np.ndarray) -> np.ndarray:
    """(N, 2 * 4 * 72) float64 of pictures (N, H, W, 3) uint8: means and deviations of each cell."""
    layers = _network()
    rows = []
    with torch.no_grad():
        for first in range(0, len(pictures), _BATCH):
            maps, parts = as_floats(torch.from_numpy(pictures[first : first + _BATCH])), []
            for layer in layers:
                maps = layer(maps)
                mean = nn.functional.adaptive_avg_pool2d(maps, 2)
                square = nn.functional.adaptive_avg_pool2d(maps * maps, 2)
                parts += [mean.flatten(1), (square - mean**2).clamp_min(0).sqrt().flatten(1)]
                maps = nn.functional.avg_pool2d(maps, 2)
            rows.append(torch.cat(parts, 1).double().numpy())
    return np.concatenate(rows)


def kernel_distance(made: np.ndarray, real: np.ndarray, seed: int = 0) -> float:
    """KID (Binkowski et al. 2018): unbiased squared MMD of a cubic kernel, over splits of 50.

    Args:
        made: features (N, D).
        real: features (M, D); both are standardised by these.
        seed: of the splits.
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


def frechet_distance(made: np.ndarray, real: np.ndarray, dimensions: int = 32) -> float:
    """FID (Heusel et al. 2017) between normal distributions fitted to the main directions.

    Only the ``dimensions`` principal directions of ``real`` are compared: a covariance of more
    could not be estimated from some hundred pictures.
    """
    made, real = _standardised(made, real)
    _, _, directions = np.linalg.svd(real - real.mean(0), full_matrices=False)
    a, b = made @ directions[:dimensions].T, real @ directions[:dimensions].T
    covariances = np.cov(a, rowvar=False), np.cov(b, rowvar=False)
    root = _square_root(covariances[1])
    # Tr sqrt(A B) = Tr sqrt(sqrt(B) A sqrt(B)), whose argument is symmetric.
    eigenvalues = np.linalg.eigvalsh(root @ covariances[0] @ root)
    shared = np.sqrt(eigenvalues.clip(0.0)).sum()
    apart = ((a.mean(0) - b.mean(0)) ** 2).sum()
    return float(apart + np.trace(covariances[0]) + np.trace(covariances[1]) - 2.0 * shared)


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


def _square_root(matrix: np.ndarray) -> np.ndarray:
    values, vectors = np.linalg.eigh(matrix)
    return np.asarray((vectors * np.sqrt(values.clip(0.0))) @ vectors.T)
