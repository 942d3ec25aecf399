"""A parser: SegNet taught on labelled frames, as a function of frames and as a translator.

As a translator its pictures are the classes that it sees, painted. A policy that learned from such
pictures drives on what is the same in simulation and in reality; what the parser gets wrong, it
gets wrong in both. It needs the parser wherever it goes.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np
import torch
from rich.console import Console
from torch import nn

from robot.contract import ImageSpec
from robot.errors import ConfigError
from robot.inference.translator import PARSING, TranslatorContract
from robot.typed_config import from_plain, to_plain
from trainer.relit import relit
from trainer.resumable import Loop, Stateful, descend
from trainer.run import atomically
from trainer.torch_file import load_torch, reading
from trainer.transfer.classes import VOID, label_set
from trainer.transfer.export import export_translator
from trainer.transfer.labelled import Labelled
from trainer.transfer.metrics import through
from trainer.transfer.networks import SEGNETS, SegNet, painted
from trainer.transfer.options import ParseOptions

_WHAT = "a parser, parser.pt of python -m trainer parse train"
LEARNING_RATE = 2e-3  # falls to zero along a cosine
CROPS = (0.6, 1.0)  # share of the frame's height and width
# Of what the loss favoured rare classes by, undone in use: lines come out two thirds as wide. All
# of it would lose the rarest classes again.
UNDONE = 0.5


class Parser:
    """Frames -> labels, with a network that was taught.

    Args:
        options: how.
        network: it; else a fresh one.
        weights: (C,) of the classes in its loss; else all alike.
    """

    def __init__(
        self,
        options: ParseOptions,
        network: SegNet | None = None,
        weights: np.ndarray | None = None,
    ) -> None:
        self.options, self.labels = options, label_set(options.labels)
        classes = len(self.labels.classes)
        self.network = (network or SegNet(classes, *SEGNETS[options.net])).eval()
        self.weights = np.ones(classes) if weights is None else weights
        # (C, 1, 1): what of its loss's favour to each class is taken off the logits
        self.favours = torch.from_numpy(UNDONE * np.log(self.weights)).float()[:, None, None]

    @property
    def image(self) -> ImageSpec:
        """What it sees."""
        height, width = self.options.size
        return ImageSpec(width, height)

    def __call__(self, frames: np.ndarray) -> np.ndarray:
        """(N, H, W, 3) uint8 RGB of the size it was taught with -> (N, H, W) uint8 labels."""
        expected = (*self.options.size, 3)
        if frames.shape[1:] != expected or frames.dtype != np.uint8:
            raise ConfigError(f"parser: expected frames (N, {expected}) uint8, got {frames.shape}")
        return through(lambda f: (self.network(f) - self.favours).argmax(1).byte(), frames, size=16)

    def export(self, name: str, path: Path) -> None:
        """Write it as an ONNX translator of whole frames at its own size, of the run ``name``.

        Raises:
            ContractError: torch and ONNX disagree.
        """
        steps, notes = self.options.steps, (f"labels {self.labels.name}",)
        contract = TranslatorContract("segnet", PARSING, self.image, name, steps, notes=notes)
        export_translator(ParsedPictures(self), contract, path)


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
    options: ParseOptions, sources: Sequence[Labelled], checkpoint: Path, console: Console
) -> Parser:
    """Train a SegNet on labelled frames, from where ``checkpoint`` left off."""
    torch.manual_seed(options.seed)
    weights = class_weights(sources)
    parser = Parser(options, weights=weights)
    network = parser.network.train()
    optimiser = torch.optim.Adam(network.parameters(), LEARNING_RATE)
    schedule = torch.optim.lr_scheduler.CosineAnnealingLR(optimiser, options.steps)
    loss_of = nn.CrossEntropyLoss(torch.from_numpy(weights), ignore_index=VOID)

    def step(rng: np.random.Generator, _: int) -> str:
        frames, truth = draw_batch(sources, options.batch, rng)
        loss = loss_of(network(torch.from_numpy(frames)), torch.from_numpy(truth).long())
        descend(optimiser, loss)
        schedule.step()
        return f"loss {float(loss.detach()):.3f}"

    parts: dict[str, Stateful] = {"network": network, "optimiser": optimiser, "schedule": schedule}
    Loop(checkpoint, parts, options.steps, options.seed).run(step, "SegNet", console)
    network.eval()
    return parser


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
    """Write options and weights, whole or not at all."""
    content = {
        "options": to_plain(parser.options),
        "network": parser.network.state_dict(),
        "weights": parser.weights.tolist(),
    }
    with atomically(path) as temporary:
        torch.save(content, temporary)


def load_parser(path: Path) -> Parser:
    """Read what `save_parser` wrote; ConfigError if it is absent, damaged or something else."""
    content = load_torch(path, _WHAT)
    with reading(path, _WHAT):
        options = from_plain(ParseOptions, content["options"], str(path))
        parser = Parser(options, weights=np.array(content["weights"]))
        parser.network.load_state_dict(content["network"])
    return parser
