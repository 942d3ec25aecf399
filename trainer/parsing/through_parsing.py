"""Paper B's realistic translation network: virtual -> parsing -> real, two pix2pix in a row.

The first learns from the simulator's frames and labels, the second from photographs and what a
parser sees in them; or from the frames and labels of another simulated world, which then stands
for the real one (paper B, section 3.2). Between the two the picture is read: each pixel becomes the
nearest class's colour, as the second network learned to take it.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import torch
from rich.console import Console
from torch import nn
from torch.nn import functional
from torch.optim.lr_scheduler import LambdaLR

from robot.camera.replay import picture_files, read_picture
from robot.camera.source import fit_to_frame
from robot.contract import ImageSpec
from robot.errors import ConfigError
from robot.inference.preprocess import preprocess, preprocess_batch
from trainer.parsing.classes import ROAD, LabelSet
from trainer.parsing.labelled import load_pairs
from trainer.parsing.pix2pix import Pix2Pix, UNet
from trainer.parsing.train import Parser
from trainer.resumable import Loop, Stateful

FRAME = (120, 160)  # height, width [px]


@dataclass(frozen=True)
class Pairs:
    """Pictures to translate and what they should become, both (N, H, W, 3) uint8."""

    given: np.ndarray
    wanted: np.ndarray

    def reversed(self) -> Pairs:
        """The other way."""
        return Pairs(self.wanted, self.given)

    def draw(self, count: int, rng: np.random.Generator) -> tuple[torch.Tensor, torch.Tensor]:
        """``count`` pairs (N, 3, H, W) in [-1, 1], half of them in the mirror."""
        chosen = rng.integers(len(self.given), size=count)
        mirrored = rng.random(count) < 0.5
        parts = []
        for pictures in (self.given[chosen], self.wanted[chosen]):
            pictures = np.where(mirrored[:, None, None, None], pictures[:, :, ::-1], pictures)
            parts.append(as_floats(torch.from_numpy(np.ascontiguousarray(pictures))))
        return parts[0], parts[1]


def virtual_pairs(
    collection: Path, image: ImageSpec, labels: LabelSet = ROAD, parser: Parser | None = None
) -> Pairs:
    """A simulator's frames and their labels painted, as a policy's pictures.

    Args:
        collection: its folder.
        image: the policy's picture.
        labels: of the pictures painted.
        parser: says what is seen, in place of the simulator's own labels.

    Raises:
        ConfigError: not a collection.
    """
    data = load_pairs(collection, labels, FRAME)
    given = np.stack([preprocess(frame, image) for frame in data.frames])
    if parser is not None:
        seen = class_pictures(data.frames, parser, image)
    else:
        # labels are made small as frames are, so that a thin line does not come and go
        seen = np.stack([preprocess(labels.paint(truth), image) for truth in data.truth])
    return Pairs(given, labels.paint(labels.read(seen)))


def real_pairs(photographs: Path, parser: Parser, image: ImageSpec) -> Pairs:
    """What a parser sees in photographs, painted, and the photographs, as a policy's pictures.

    Raises:
        ConfigError: no photographs, or a parser with other labels.
    """
    frames = np.stack([fit_to_frame(read_picture(path)) for path in picture_files(photographs)])
    seen = class_pictures(frames, parser, image)
    return Pairs(ROAD.paint(ROAD.read(seen)), preprocess_batch(frames, image))


def class_pictures(frames: np.ndarray, parser: Parser, image: ImageSpec) -> np.ndarray:
    """What a parser sees in frames (N, 120, 160, 3), painted, as a policy's pictures.

    The parser may look at larger pictures than the policy: what it sees is then made smaller, and
    edges blend.

    Raises:
        ConfigError: a parser with other labels.
    """
    if parser.labels is not ROAD:
        raise ConfigError(f"parser: expected one of labels 'road', got {parser.labels.name!r}")
    height, width = parser.config.size
    seen = ROAD.paint(parser(preprocess_batch(frames, ImageSpec(width, height))))
    return np.stack([preprocess(_enlarged(picture), image) for picture in seen])


def _enlarged(picture: np.ndarray) -> np.ndarray:
    return np.asarray(cv2.resize(picture, FRAME[::-1], interpolation=cv2.INTER_NEAREST))


def teach_pairs(
    model: Pix2Pix, pairs: Pairs, steps: int, seed: int, checkpoint: Path, console: Console
) -> UNet:
    """Train one translation, from where ``checkpoint`` left off.

    The rate is constant for half of the steps and then falls linearly to nothing, as in Isola et
    al. 2017: the last updates would else leave their own texture on even surfaces.
    """

    def falling(k: int) -> float:
        return min(1.0, 2.0 - 2.0 * k / steps)

    rates = [LambdaLR(optimiser, falling) for optimiser in (model.of_generator, model.of_critic)]
    parts: dict[str, Stateful] = {
        "generator": model.generator,
        "critic": model.critic,
        "of_generator": model.of_generator,
        "of_critic": model.of_critic,
        "rate_of_generator": rates[0],
        "rate_of_critic": rates[1],
    }

    def step(rng: np.random.Generator, _: int) -> str:
        left = model.step(*pairs.draw(model.config.batch, rng))
        for rate in rates:
            rate.step()
        return f"L1 {left:.3f}"

    Loop(checkpoint, parts, steps, seed).run(step, checkpoint.stem, console)
    return model.generator.eval()


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


class ThroughParsing(nn.Module):
    """Both networks as one: (N, H, W, 3) uint8 RGB -> the same; what is exported."""

    colours: torch.Tensor  # (C, 3) in [-1, 1]
    offsets: torch.Tensor  # (C,) their squared lengths

    def __init__(self, to_parsing: UNet, to_real: UNet, labels: LabelSet = ROAD) -> None:
        super().__init__()
        self.to_parsing, self.to_real = to_parsing, to_real
        colours = torch.tensor(labels.colours, dtype=torch.float32)
        self.register_buffer("colours", colours / 127.5 - 1.0)
        self.register_buffer("offsets", self.colours.square().sum(1))

    def parsed(self, pictures: torch.Tensor) -> torch.Tensor:
        """(N, H, W, 3) uint8 -> (N, 3, H, W), each pixel one class's colour in [-1, 1]."""
        seen = self.to_parsing(as_floats(pictures))
        # |p|^2 less |p - c|^2
        nearness = functional.conv2d(seen, 2.0 * self.colours[:, :, None, None], -self.offsets)
        return painted(nearness, self.colours)

    def forward(self, image: torch.Tensor) -> torch.Tensor:
        """See the class."""
        return as_bytes(self.to_real(self.parsed(image)))


def as_floats(pictures: torch.Tensor) -> torch.Tensor:
    """(N, H, W, 3) uint8 -> (N, 3, H, W) float32 in [-1, 1]."""
    return pictures.permute(0, 3, 1, 2).float() / 127.5 - 1.0


def as_bytes(pictures: torch.Tensor) -> torch.Tensor:
    """(N, 3, H, W) float32 in [-1, 1] -> (N, H, W, 3) uint8."""
    scaled = ((pictures + 1.0) * 127.5 + 0.5).clamp(0.0, 255.0)
    return scaled.to(torch.uint8).permute(0, 2, 3, 1)
