"""Teaching SegNet, and a taught one as a function of frames."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from rich.console import Console
from torch import nn

from robot.errors import ConfigError, nearest
from trainer.parsing.augment import draw_batch
from trainer.parsing.classes import VOID, label_set
from trainer.parsing.labelled import Labelled
from trainer.parsing.scores import ParsingScore, confusion, score
from trainer.parsing.segnet import SEGNETS, SegNet
from trainer.resumable import Loop, Stateful
from trainer.run import atomically
from trainer.torch_file import load_torch, reading

BATCH_OF_USE = 16
# Of what the loss favoured rare classes by, undone in use: lines come out two thirds as wide. All
# of it would lose the rarest classes again. `trainer.parsing.choose` finds it on training frames.
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
        if self.net not in SEGNETS:
            raise ConfigError(f"net: unknown {self.net!r}; {nearest(self.net, SEGNETS)}")

    @property
    def size(self) -> tuple[int, int]:
        """(height, width) of what the network sees [px]."""
        return (self.height_px, self.width_px)


class Parser:
    """Frames -> labels, with a network that was taught."""

    def __init__(
        self,
        config: ParseConfig,
        network: SegNet,
        weights: np.ndarray | None = None,
        undone: float = UNDONE,
    ) -> None:
        """``weights``: (C,) of the classes in its loss; none of parsers from before.

        ``undone``: the share of their favour that is taken back.
        """
        self.config = config
        self.labels = label_set(config.labels)
        self.network = network.eval()
        self.weights = np.ones(len(self.labels.classes)) if weights is None else weights
        self.undone = undone

    @property
    def favours(self) -> torch.Tensor:
        """(C, 1, 1): what of its loss's favour to each class is taken off the logits."""
        return torch.from_numpy(self.undone * np.log(self.weights)).float()[:, None, None]

    @torch.no_grad()
    def __call__(self, frames: np.ndarray) -> np.ndarray:
        """(N, H, W, 3) uint8 RGB of the size it was taught with -> (N, H, W) uint8 labels."""
        expected = (*self.config.size, 3)
        if frames.shape[1:] != expected or frames.dtype != np.uint8:
            raise ConfigError(f"parser: expected frames (N, {expected}) uint8, got {frames.shape}")
        found = np.empty(frames.shape[:3], np.uint8)
        for i in range(0, len(frames), BATCH_OF_USE):
            part = torch.from_numpy(np.ascontiguousarray(frames[i : i + BATCH_OF_USE]))
            logits = self.network(part) - self.favours
            found[i : i + BATCH_OF_USE] = logits.argmax(1).numpy()
        return found


def teach(
    config: ParseConfig, sources: Sequence[Labelled], checkpoint: Path, console: Console
) -> Parser:
    """Train a SegNet on labelled frames, from where ``checkpoint`` left off."""
    torch.manual_seed(config.seed)
    labels = label_set(config.labels)
    network = SegNet(len(labels.classes), SEGNETS[config.net])
    optimiser = torch.optim.Adam(network.parameters(), config.learning_rate)
    schedule = torch.optim.lr_scheduler.CosineAnnealingLR(optimiser, config.steps)
    weights = class_weights(sources)
    loss_of = nn.CrossEntropyLoss(torch.from_numpy(weights), ignore_index=VOID)
    network.train()

    def step(rng: np.random.Generator, _: int) -> str:
        frames, truth = draw_batch(sources, config.batch, rng)
        loss = loss_of(network(torch.from_numpy(frames)), torch.from_numpy(truth).long())
        optimiser.zero_grad()
        loss.backward()
        optimiser.step()
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
    what = "a parser, parser.pt of python -m trainer parse train"
    content = load_torch(path, what)
    with reading(path, what):
        config = ParseConfig(**content["config"])
        network = SegNet(len(label_set(config.labels).classes), SEGNETS[config.net])
        network.load_state_dict(content["network"])
        weights = content.get("weights")
    return Parser(config, network, None if weights is None else np.array(weights))


def evaluate(parser: Parser, data: Labelled, source: str = "") -> ParsingScore:
    """Scores on labelled frames."""
    found = parser(data.frames)
    matrix = confusion(data.truth, found, len(data.labels.classes))
    return score(matrix, data.labels, len(data), source)
