"""A parser: SegNet taught on labelled frames, as a function of frames and as a translator.

As a translator its pictures are the classes that it sees, painted. A policy that learned from such
pictures drives on what is the same in simulation and in reality; what the parser gets wrong, it
gets wrong in both. It needs the parser wherever it goes.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import torch
from rich.console import Console
from torch import nn

from robot.contract import ImageSpec
from robot.errors import ConfigError
from trainer.relit import relit
from trainer.resumable import Loop, Stateful, descend
from trainer.run import atomically
from trainer.torch_file import load_torch, reading
from trainer.transfer.classes import VOID, LabelSet, label_set
from trainer.transfer.labelled import Labelled
from trainer.transfer.metrics import ParsingScore, confusion, score, through
from trainer.transfer.networks import SEGNETS, SegNet, painted
from trainer.transfer.options import Sources, known_net
from trainer.transfer.pictures import spread
from trainer.transfer.sheet import ROWS, draw_sheet

_WHAT = "a parser, parser.pt of python -m trainer parse train"
CROPS = (0.6, 1.0)  # share of the frame's height and width
# Of what the loss favoured rare classes by, undone in use: lines come out two thirds as wide. All
# of it would lose the rarest classes again.
UNDONE = 0.5


@dataclass(frozen=True)
class ParseConfig:
    """How a parser is taught."""

    labels: str
    net: str = "small"
    height_px: int = 120
    width_px: int = 160
    steps: int = 2000
    batch: int = 8
    learning_rate: float = 2e-3  # falls to zero along a cosine
    seed: int = 0

    def __post_init__(self) -> None:
        label_set(self.labels)
        known_net(self.net)

    @property
    def size(self) -> tuple[int, int]:
        """(height, width) of what the network sees [px]."""
        return (self.height_px, self.width_px)

    @property
    def image(self) -> ImageSpec:
        """Likewise."""
        return ImageSpec(self.width_px, self.height_px)

    @property
    def label_set(self) -> LabelSet:
        """What it calls what it sees."""
        return label_set(self.labels)

    def network(self) -> SegNet:
        """A fresh one."""
        return SegNet(len(self.label_set.classes), *SEGNETS[self.net])


@dataclass(frozen=True)
class ParseRun:
    """``config.yaml``."""

    parse: ParseConfig
    sources: Sources


class Parser:
    """Frames -> labels, with a network that was taught.

    Args:
        config: how.
        network: it.
        weights: (C,) of the classes in its loss; none of parsers from before.
    """

    def __init__(
        self, config: ParseConfig, network: SegNet, weights: np.ndarray | None = None
    ) -> None:
        self.config, self.network = config, network.eval()
        self.labels = config.label_set
        self.weights = np.ones(len(self.labels.classes)) if weights is None else weights
        # (C, 1, 1): what of its loss's favour to each class is taken off the logits
        self.favours = torch.from_numpy(UNDONE * np.log(self.weights)).float()[:, None, None]

    def __call__(self, frames: np.ndarray) -> np.ndarray:
        """(N, H, W, 3) uint8 RGB of the size it was taught with -> (N, H, W) uint8 labels."""
        expected = (*self.config.size, 3)
        if frames.shape[1:] != expected or frames.dtype != np.uint8:
            raise ConfigError(f"parser: expected frames (N, {expected}) uint8, got {frames.shape}")
        return through(lambda some: self.logits(some).argmax(1).byte(), frames, size=16)

    def logits(self, frames: torch.Tensor) -> torch.Tensor:
        """(N, H, W, 3) uint8 -> (N, C, H, W), the favour for rare classes taken back."""
        logits: torch.Tensor = self.network(frames) - self.favours
        return logits


class ParsedPictures(nn.Module):
    """A parser as a translator: each pixel its class's colour; what is exported."""

    favours: torch.Tensor  # (C, 1, 1) to be taken off the logits
    colours: torch.Tensor  # (C, 3)

    def __init__(self, parser: Parser) -> None:
        super().__init__()
        self.network = parser.network
        self.register_buffer("favours", parser.favours)
        self.register_buffer("colours", torch.tensor(parser.labels.colours, dtype=torch.float32))

    def forward(self, image: torch.Tensor) -> torch.Tensor:
        """(N, H, W, 3) uint8 RGB -> the same."""
        seen = painted(self.network(image) - self.favours, self.colours)
        return seen.to(torch.uint8).permute(0, 2, 3, 1)


def teach(
    config: ParseConfig, sources: Sequence[Labelled], checkpoint: Path, console: Console
) -> Parser:
    """Train a SegNet on labelled frames, from where ``checkpoint`` left off."""
    torch.manual_seed(config.seed)
    network = config.network()
    optimiser = torch.optim.Adam(network.parameters(), config.learning_rate)
    schedule = torch.optim.lr_scheduler.CosineAnnealingLR(optimiser, config.steps)
    weights = class_weights(sources)
    loss_of = nn.CrossEntropyLoss(torch.from_numpy(weights), ignore_index=VOID)
    network.train()

    def step(rng: np.random.Generator, _: int) -> str:
        frames, truth = draw_batch(sources, config.batch, rng)
        loss = loss_of(network(torch.from_numpy(frames)), torch.from_numpy(truth).long())
        descend(optimiser, loss)
        schedule.step()
        return f"loss {float(loss.detach()):.3f}"

    parts: dict[str, Stateful] = {"network": network, "optimiser": optimiser, "schedule": schedule}
    Loop(checkpoint, parts, config.steps, config.seed).run(step, "SegNet", console)
    return Parser(config, network, weights)


def class_weights(sources: Sequence[Labelled], strongest: float = 10.0) -> np.ndarray:
    """(C,) float32: the square root of median-frequency balancing.

    SegNet balances fully (Eigen and Fergus 2015), which buys the rare classes' accuracy with
    everyone's intersection over union; the root lies between that and none. Absent classes have
    weight 1.
    """
    classes = len(sources[0].labels.classes)
    shares = np.zeros(classes)
    for source in sources:
        counts = np.bincount(source.truth[source.truth != VOID], minlength=classes)
        shares += counts / max(1, counts.sum())
    occurs = shares > 0
    weights = np.ones(classes)
    weights[occurs] = np.sqrt(np.median(shares[occurs]) / shares[occurs])
    return np.minimum(weights, strongest).astype(np.float32)


def draw_batch(
    sources: Sequence[Labelled], count: int, rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray]:
    """``count`` frames (N, H, W, 3) and labels (N, H, W), cropped, mirrored and relit at random.

    Every source is drawn from as often as every other, however many frames it has.
    """
    shape = sources[0].truth.shape[1:]
    frames, truth = np.empty((count, *shape, 3), np.uint8), np.empty((count, *shape), np.uint8)
    for out in range(count):
        source = sources[int(rng.integers(len(sources)))]
        i = int(rng.integers(len(source)))
        sizes = [max(1, round(share * full)) for share in [rng.uniform(*CROPS)] for full in shape]
        starts = [int(rng.integers(full - n + 1)) for full, n in zip(shape, sizes, strict=True)]
        window = tuple(slice(a, a + n) for a, n in zip(starts, sizes, strict=True))
        step = -1 if rng.integers(2) else 1  # mirrored, or not
        frame = cv2.resize(source.frames[i][window], shape[::-1], interpolation=cv2.INTER_LINEAR)
        frames[out] = relit(frame[:, ::step], rng)
        label = cv2.resize(source.truth[i][window], shape[::-1], interpolation=cv2.INTER_NEAREST)
        truth[out] = label[:, ::step]
    return frames, truth


def save_parser(parser: Parser, path: Path) -> None:
    """Write configuration and weights, whole or not at all."""
    with atomically(path) as temporary:
        content = {
            "config": vars(parser.config),
            "network": parser.network.state_dict(),
            "weights": parser.weights.tolist(),
        }
        torch.save(content, temporary)


def load_parser(path: Path) -> Parser:
    """Read what `save_parser` wrote.

    Raises:
        ConfigError: no such file.
    """
    if not path.exists():
        raise ConfigError(f"{path}: expected a parser, found no such file; train one first")
    content = load_torch(path, _WHAT)
    with reading(path, _WHAT):
        config = ParseConfig(**content["config"])
        network = config.network()
        network.load_state_dict(content["network"])
        weights = content.get("weights")
    return Parser(config, network, None if weights is None else np.array(weights))


def evaluate(parser: Parser, data: Labelled, source: str = "") -> ParsingScore:
    """Scores on labelled frames."""
    found = parser(data.frames)
    matrix = confusion(data.truth, found, len(data.labels.classes))
    return score(matrix, data.labels, len(data), source)


def draw_parsed(parser: Parser, data: Labelled, path: Path) -> None:
    """Write rows of frame, classes found, true classes: `ROWS` frames spread over the data."""
    chosen = data.pick(spread(len(data), min(ROWS, len(data))))
    found, truth = (data.labels.paint(some) for some in (parser(chosen.frames), chosen.truth))
    draw_sheet(path, {"frame": chosen.frames, "classes found": found, "true classes": truth})
