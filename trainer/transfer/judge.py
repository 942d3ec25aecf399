"""How well a translator does: closer to photographs, and lines where they were.

KID is told from features that need no download: those of a fixed network of random filters, three
convolutions drawn from seed 0, each followed by rectification and halving, averaged over a grid of
2 x 2 cells at every depth, and standardised by the set compared with. A deviation there counts for
no less than one grey level: in a set whose skies are all alike some features hardly deviate.

Untrained filters answer to colour, contrast, sharpness, noise and oriented texture, and hardly to
what things are. Figures compare with others of the same folders and picture size only.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import cv2
import numpy as np
import torch
from torch import nn

from robot.errors import ConfigError
from robot.inference.translator import OnnxTranslator
from trainer.transfer.networks import as_floats, through
from trainer.transfer.pictures import Pictures, load_paint, load_pictures

LANE_OVERLAP = 0.85  # of the lines in picture and translation: what a translation must keep
_MARGIN = 0.01  # more than is due, since other pictures give other figures
FEWEST = 2  # pictures that a distance can be told from
_CHANNELS = (16, 24, 32)
_SPLITS = 40
_SPLIT = 50
_GREY_LEVEL = 2.0 / 255.0  # of pictures as the networks get them, -1 .. 1
_FLOOR_SHARE = 0.98  # of a pixel that must be white or yellow paint, or road
_LEAST_CONTRAST = 25.0  # grey levels between paint and road, below which nothing is a line


class Score(NamedTuple):
    """How good a translator sim-to-real is."""

    kid: float  # distance to the photographs, of all collections together
    lanes: float  # lines kept, in the collection where it is least

    def better_than(self, other: Score | None) -> bool:
        """Closer to photographs, among those that keep enough lines; else by the lines kept."""
        if other is None:
            return True
        due = LANE_OVERLAP + _MARGIN
        if min(self.lanes, other.lanes) >= due:
            return self.kid < other.kid
        return self.lanes > other.lanes


class Judge:
    """Judges translators sim-to-real by pictures, their paint (`load_paint`) and photographs.

    ConfigError if there are too few of either.
    """

    def __init__(self, sim: Pictures, paint: np.ndarray, photographs: np.ndarray) -> None:
        if min(len(sim.images), len(photographs)) < FEWEST:
            raise ConfigError(
                f"translation: expected at least {2 * FEWEST} simulated pictures in a collection "
                f"and {2 * FEWEST} photographs of a drive, got too few to judge translations by"
            )
        self._real = features(photographs)
        self._parts = []
        for number in np.unique(sim.folder):
            mine = sim.folder == number
            found = bright_lines(sim.images[mine], paint[mine])
            self._parts.append((sim.images[mine], paint[mine], found))

    def score(self, translate: Callable[[np.ndarray], np.ndarray]) -> Score:
        """Of what makes of pictures (N, H, W, 3) uint8 others of the same size."""
        seen, kept = [], []
        for pictures, paint, found in self._parts:
            translated = translate(pictures)
            seen.append(features(translated))
            kept.append(overlap(bright_lines(translated, paint), found))
        return Score(kernel_distance(np.concatenate(seen), self._real), min(kept))

    def apart(self) -> float:
        """KID of every second photograph from the others: as close as it gets."""
        return kernel_distance(self._real[::2], self._real[1::2])


def judge(translator: OnnxTranslator, sim: Sequence[Path], real: Sequence[Path]) -> dict[str, Any]:
    """``--json`` of ``translate judge``: distances to photographs, and the lines kept.

    ``sim`` are collections from the simulator, best none that it was trained with.
    """
    simulated, photographs = (load_pictures(paths, translator.image) for paths in (sim, real))
    asked = Judge(simulated, load_paint(simulated, translator.image), photographs.images)
    before, after = asked.score(lambda pictures: pictures), asked.score(translator)
    return {
        "translator": str(translator.path),
        "pictures": len(simulated.images),
        "photographs": len(photographs.images),
        "kid_before": before.kid,
        "kid_after": after.kid,
        "kid_apart": asked.apart(),  # photographs from each other
        "lanes_kept": after.lanes,  # in the collection where it is least; LANE_OVERLAP is due
    }


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
