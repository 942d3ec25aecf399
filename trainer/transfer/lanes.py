"""A small network that finds painted lines, to judge where a translation has them.

It learns from simulated pictures with their labels, under colours, light, blur and noise far
stronger than any look's, and never sees a photograph or a translation. It is no part of a
translation's training, so that a translation cannot learn to please it. It is not SegNet, whose
loss favours rare classes: lines come out too wide.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import torch
from rich.console import Console
from torch import nn
from torch.nn import functional

from robot.contract import ImageSpec
from robot.errors import ConfigError
from robot.typed_config import from_plain, to_plain
from trainer.resumable import Loop, descend, set_rate
from trainer.run import atomically
from trainer.torch_file import load_torch, reading
from trainer.transfer.metrics import through, true_lines
from trainer.transfer.networks import as_floats, resized
from trainer.transfer.pictures import load_paint, load_pictures

_WIDTH = 16
_BATCH = 8
_RATE = 2e-3  # falls linearly to nothing
_FINDER = "a lane finder"


class LaneFinder(nn.Module):
    """(N, H, W, 3) uint8 -> (N, 3, H, W) logits: nothing, white line, yellow line."""

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
        fine = self.fine(as_floats(pictures))
        middle = self.middle(fine)
        up = resized(self.coarse(middle), middle.shape[2:])
        up = resized(self.up_middle(torch.cat((up, middle), 1)), fine.shape[2:])
        logits: torch.Tensor = self.up_fine(torch.cat((up, fine), 1))
        return logits

    def find(self, pictures: np.ndarray, paint: np.ndarray | None = None) -> np.ndarray:
        """(N, H, W) uint8: 0 nothing, 1 white line, 2 yellow line; it needs no ``paint``."""
        del paint
        return through(lambda some: self(some).argmax(1).byte(), pictures, size=64)


def train_lane_finder(
    sim: Sequence[Path], image: ImageSpec, steps: int, seed: int, console: Console
) -> LaneFinder:
    """Learn from collections from the simulator.

    Raises:
        ConfigError: one is absent, empty or without labels.
    """
    pictures = load_pictures(sim, image)
    white, yellow = true_lines(load_paint(pictures, image)).swapaxes(0, 1)
    truth = np.select((yellow, white), (2, 1), 0).astype(np.int64)
    torch.set_num_threads(1)
    torch.manual_seed(seed)
    rng, finder = np.random.default_rng(seed), LaneFinder()
    optimiser = torch.optim.Adam(finder.parameters(), _RATE)

    def step(_: np.random.Generator, k: int) -> str:
        set_rate([optimiser], _RATE * (1.0 - k / steps))
        chosen = rng.integers(len(truth), size=_BATCH)
        seen = np.stack([disturbed(pictures.images[i], rng) for i in chosen])
        loss = functional.cross_entropy(
            finder(torch.from_numpy(seen)), torch.from_numpy(truth[chosen])
        )
        descend(optimiser, loss)
        return f"loss {float(loss.detach()):.3f}"

    with TemporaryDirectory() as scratch:
        Loop(Path(scratch) / "lanes.pt", {"finder": finder}, steps, seed).run(
            step, "lanes", console
        )
    return finder.eval()


def disturbed(picture: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """A picture (H, W, 3) uint8 in other colours, light, sharpness and noise."""
    floats = (picture / 255.0) ** rng.uniform(0.6, 1.6)
    floats = floats * np.exp(rng.normal(0.0, 0.25, 3)) + rng.normal(0.0, 0.05, 3)
    if rng.random() < 0.5:  # a soft blur along a random direction
        axis = int(rng.integers(2))
        floats = 0.5 * floats + 0.25 * (np.roll(floats, 1, axis) + np.roll(floats, -1, axis))
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
    content, finder = load_torch(path, _FINDER), LaneFinder()
    with reading(path, _FINDER):
        made_for = from_plain(ImageSpec, content["image"])
    if made_for != image:
        raise ConfigError(f"{path}: expected one for {image}, got one for {made_for}")
    with reading(path, _FINDER):
        finder.load_state_dict(content["weights"])
    return finder.eval()


def _layers(before: int, after: int, stride: int, dilation: int = 1) -> nn.Sequential:
    convolution = nn.Conv2d(before, after, 3, stride, dilation, dilation, bias=False)
    return nn.Sequential(convolution, nn.BatchNorm2d(after), nn.ReLU())
