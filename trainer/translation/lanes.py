"""A small network that finds painted lines, to judge where a translation has them.

It learns from simulated pictures with their labels, under colours, light, blur and noise far
stronger than any look's, and never sees a photograph or a translation. It is no part of the
translation's training, so that a translation cannot learn to please it.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import nn
from torch.nn import functional
from tqdm import tqdm

from robot.contract import ImageSpec
from robot.errors import ConfigError
from robot.typed_config import from_plain, to_plain
from trainer.run import atomically
from trainer.torch_file import load_torch, reading
from trainer.translation.networks import as_floats
from trainer.translation.pictures import Pictures, load_paint

_WIDTH = 16
_LANE_SHARE = 0.5  # of a pixel, from which it counts as line
_BATCH = 8

_FINDER = "a lane finder"


class LaneFinder(nn.Module):
    """(N, 3, H, W) in [-1, 1] -> (N, 3, H, W) logits: nothing, white line, yellow line."""

    def __init__(self) -> None:
        super().__init__()
        w = _WIDTH
        self.fine = _layers(3, w, 1)
        self.middle = _layers(w, 2 * w, 2)
        self.coarse = nn.Sequential(_layers(2 * w, 2 * w, 2), _layers(2 * w, 2 * w, 1, 2))
        self.up_middle = _layers(4 * w, w, 1)
        self.up_fine = nn.Sequential(_layers(2 * w, w, 1), nn.Conv2d(w, 3, 1))

    def forward(self, pictures: torch.Tensor) -> torch.Tensor:
        """The logits."""
        fine = self.fine(pictures)
        middle = self.middle(fine)
        up = functional.interpolate(self.coarse(middle), size=middle.shape[2:])
        up = self.up_middle(torch.cat((up, middle), 1))
        up = functional.interpolate(up, size=fine.shape[2:])
        logits: torch.Tensor = self.up_fine(torch.cat((up, fine), 1))
        return logits


def lane_masks(
    finder: LaneFinder, pictures: np.ndarray, paint: np.ndarray | None = None, batch: int = 64
) -> np.ndarray:
    """(N, H, W) uint8 of pictures (N, H, W, 3) uint8: 0 nothing, 1 white line, 2 yellow line.

    The network needs no ``paint``; it is there for those who judge.
    """
    del paint
    masks = []
    with torch.no_grad():
        for first in range(0, len(pictures), batch):
            part = torch.from_numpy(pictures[first : first + batch])
            masks.append(finder(as_floats(part)).argmax(1).to(torch.uint8).numpy())
    return np.concatenate(masks)


def true_masks(paint: np.ndarray) -> np.ndarray:
    """(N, H, W) as of `lane_masks`, from shares of paint (N, 4, H, W) uint8."""
    white, yellow = (paint[:, k] > 255 * _LANE_SHARE for k in (0, 1))
    return np.where(yellow, 2, np.where(white, 1, 0)).astype(np.uint8)


def overlap(found: np.ndarray, expected: np.ndarray) -> float:
    """Intersection over union of all line pixels of masks (N, H, W), whatever their colour."""
    both = ((found > 0) & (expected > 0)).sum()
    either = ((found > 0) | (expected > 0)).sum()
    return float(both / either) if either else 1.0


def train_lane_finder(
    pictures: Pictures, image: ImageSpec, steps: int, seed: int = 0
) -> LaneFinder:
    """Learn from simulated pictures with labels.

    Raises:
        ConfigError: a picture has no labels.
    """
    torch.manual_seed(seed)
    rng = np.random.default_rng(seed)
    truth = true_masks(load_paint(pictures, image)).astype(np.int64)
    finder = LaneFinder()
    optimiser = torch.optim.Adam(finder.parameters(), 2e-3)
    for step in tqdm(range(steps), unit="step", dynamic_ncols=True):
        for group in optimiser.param_groups:
            group["lr"] = 2e-3 * (1.0 - step / steps)
        chosen = rng.integers(len(truth), size=_BATCH)
        seen = np.stack([disturbed(pictures.images[k], rng) for k in chosen])
        logits = finder(as_floats(torch.from_numpy(seen)))
        loss = functional.cross_entropy(logits, torch.from_numpy(truth[chosen]))
        optimiser.zero_grad(set_to_none=True)
        loss.backward()
        optimiser.step()
    return finder.eval()


def disturbed(picture: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """A picture (H, W, 3) uint8 in other colours, light, sharpness and noise."""
    floats = (picture / 255.0) ** rng.uniform(0.6, 1.6)
    floats = floats * np.exp(rng.normal(0.0, 0.25, 3)) + rng.normal(0.0, 0.05, 3)
    if rng.random() < 0.5:
        floats = _mixed_with_shifted(floats, rng)
    floats = floats + rng.normal(0.0, rng.uniform(0.0, 0.05), picture.shape)
    return np.asarray((255.0 * floats).clip(0, 255), np.uint8)


def save_lane_finder(path: Path, finder: LaneFinder, image: ImageSpec) -> None:
    """Write the weights, with the pictures that they are for."""
    with atomically(path) as temporary:
        torch.save({"image": to_plain(image), "weights": finder.state_dict()}, temporary)


def load_lane_finder(path: Path, image: ImageSpec) -> LaneFinder:
    """Read what `save_lane_finder` wrote.

    Raises:
        ConfigError: it is absent, or for other pictures.
    """
    if not path.exists():
        raise ConfigError(
            f"{path}: expected a lane finder, got no file; make it with "
            "python -m trainer translate lanes"
        )
    content: dict[str, Any] = load_torch(path, _FINDER)
    with reading(path, _FINDER):
        made_for = from_plain(ImageSpec, content["image"])
    if made_for != image:
        raise ConfigError(f"{path}: expected one for {image}, got one for {made_for}")
    finder = LaneFinder()
    with reading(path, _FINDER):
        finder.load_state_dict(content["weights"])
    return finder.eval()


def _layers(before: int, after: int, stride: int, dilation: int = 1) -> nn.Sequential:
    return nn.Sequential(
        nn.Conv2d(before, after, 3, stride, dilation, dilation, bias=False),
        nn.BatchNorm2d(after),
        nn.ReLU(),
    )


def _mixed_with_shifted(floats: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """A soft blur along a random direction."""
    axis = int(rng.integers(2))
    return np.asarray(0.5 * floats + 0.25 * (np.roll(floats, 1, axis) + np.roll(floats, -1, axis)))
