"""A parser: SegNet taught on labelled frames, as a function of frames and as a translator.

As a translator its pictures are the classes that it sees, painted: what a policy that learned from
them drives on is the same in simulation and in reality. It needs the parser wherever it goes.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import torch
from rich.console import Console
from rich.table import Table
from torch import nn

from robot.contract import ImageSpec
from robot.errors import ConfigError
from robot.inference.policy import PARSING, TranslatorContract
from robot.output import write_json
from robot.typed_config import from_plain, to_plain
from trainer.export import export_translator
from trainer.relit import relit
from trainer.resumable import fit
from trainer.torch_file import loaded, save_torch
from trainer.transfer.cli import ParseOptions
from trainer.transfer.labelled import LABEL_SETS, VOID, Labelled, LabelSet, load_sources
from trainer.transfer.networks import SEGNETS, SegNet, painted, through
from trainer.transfer.pictures import SHEET_ROWS, draw_sheet, spread

_WHAT = "a parser, parser.pt of duckpilot parse train"
LEARNING_RATE = 2e-3  # falls to zero along a cosine
CROPS = (0.6, 1.0)  # share of the frame's height and width
MOST_WEIGHT = 3.16  # of a class


class Parser(nn.Module):
    """Frames -> classes; as a module it is a translator: each pixel becomes its class's colour."""

    def __init__(self, options: ParseOptions) -> None:
        super().__init__()
        self.options, self.labels = options, LABEL_SETS[options.labels]
        self.image = ImageSpec(options.size[1], options.size[0])  # what it sees
        self.network = SegNet(len(self.labels.classes), *SEGNETS[options.net])
        self.colours = nn.Buffer(torch.tensor(self.labels.colours, dtype=torch.float32))  # (C, 3)

    def parse(self, frames: np.ndarray) -> np.ndarray:
        """(N, H, W, 3) uint8 RGB of the size it was taught with -> (N, H, W) uint8 labels."""
        if frames.shape[1:] != self.image.shape:
            raise ConfigError(f"parser: expected frames {self.image.shape}, got {frames.shape[1:]}")
        return through(lambda some: self.network(some).argmax(1).byte(), frames, size=16)

    def forward(self, image: torch.Tensor) -> torch.Tensor:
        """(N, H, W, 3) uint8 RGB -> the same, painted; what is exported."""
        return painted(self.network(image), self.colours).to(torch.uint8).permute(0, 2, 3, 1)

    def export(self, name: str, path: Path) -> None:
        """Write it as an ONNX translator of whole frames at its own size, of the run ``name``."""
        steps, notes = self.options.steps, (f"labels {self.labels.name}",)
        contract = TranslatorContract("segnet", PARSING, self.image, name, steps, notes=notes)
        export_translator(self, contract, path)


def train_parser(out: Path, run: ParseOptions, console: Console) -> None:
    """Do what is left of a run in the folder ``out``, and tell how well held-out frames are parsed.

    ConfigError if there is nothing to learn from.
    """
    names, training, held_out = zip(*load_sources(run), strict=True)
    parser = teach(run, training, out / "checkpoint.pt", console)
    save_parser(parser, out / "parser.pt")
    count, paint, scores = len(held_out[-1].names), parser.labels.paint, []
    shown = held_out[-1].pick(spread(count, min(SHEET_ROWS, count)))
    found = paint(parser.parse(shown.frames))
    columns = {"frame": shown.frames, "classes found": found, "true classes": paint(shown.truth)}
    draw_sheet(out / "sheet.png", columns)
    for name, test in zip(names, held_out, strict=True):
        score = score_classes(test.truth, parser.parse(test.frames), parser.labels, name)
        title = (
            f"{name}: mean IoU {score.mean_iou:.1%}, pixels {score.pixel_accuracy:.1%} "
            f"({score.frames} held-out frames)"
        )
        table = Table("class", "share of pixels", "accuracy", "IoU", title=title)
        for row in score.classes:
            table.add_row(row.name, *(f"{x:.1%}" for x in (row.pixels, row.accuracy, row.iou)))
        console.print(table)
        scores.append(score)
    write_json(out / "scores.json", scores)


def teach(
    options: ParseOptions, sources: Sequence[Labelled], checkpoint: Path, console: Console
) -> Parser:
    """Train a SegNet on labelled frames, from where ``checkpoint`` left off."""
    torch.manual_seed(options.seed)
    parser = Parser(options)
    optimiser = torch.optim.Adam(parser.network.parameters(), LEARNING_RATE)
    weights = torch.from_numpy(class_weights(sources, len(parser.labels.classes)))
    cross_entropy = nn.CrossEntropyLoss(weights, ignore_index=VOID)

    def loss_of(rng: np.random.Generator) -> torch.Tensor:
        frames, truth = draw_batch(sources, options.batch, rng)
        guess = parser.network(torch.from_numpy(frames))
        return cross_entropy(guess, torch.from_numpy(truth).long())

    how_long = options.steps, options.seed
    fit(parser.network, optimiser, loss_of, checkpoint, *how_long, "SegNet", console)
    return parser


def class_weights(sources: Sequence[Labelled], classes: int) -> np.ndarray:
    """(C,) float32: the fourth root of median-frequency balancing.

    SegNet balances fully (Eigen and Fergus 2015), which buys the rare classes' accuracy with
    everyone's intersection over union: lines come out too wide. With none the rarest classes are
    lost. Absent classes have weight 1.
    """
    shares = np.zeros(classes)
    for source in sources:
        counts = np.bincount(source.truth[source.truth != VOID], minlength=classes)
        shares += counts / max(1, counts.sum())
    occurs = shares > 0
    weights = np.ones(classes)
    weights[occurs] = (np.median(shares[occurs]) / shares[occurs]) ** 0.25
    return np.minimum(weights, MOST_WEIGHT).astype(np.float32)


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
        i = int(rng.integers(len(source.frames)))
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
    save_torch(path, {"options": to_plain(parser.options), "network": parser.network.state_dict()})


def load_parser(path: Path) -> Parser:
    """Read what `save_parser` wrote; ConfigError if it is absent, damaged or something else."""
    with loaded(path, _WHAT) as content:
        parser = Parser(from_plain(ParseOptions, content["options"], str(path))).eval()
        parser.network.load_state_dict(content["network"])
    return parser


@dataclass(frozen=True)
class ClassScore:
    """One class on some frames; NaN where the frames hold none of it."""

    name: str
    pixels: float  # share of the labelled pixels
    accuracy: float  # share of its pixels that were found
    iou: float  # intersection over union with the guesses


@dataclass(frozen=True)
class ParsingScore:
    """A parser on labelled frames."""

    source: str  # of the frames
    frames: int
    pixel_accuracy: float
    class_accuracy: float  # mean over the classes that occur
    mean_iou: float  # likewise
    classes: tuple[ClassScore, ...]


def score_classes(
    truth: np.ndarray, guess: np.ndarray, labels: LabelSet, source: str = ""
) -> ParsingScore:
    """The scores of guesses (N, H, W) uint8; pixels whose truth is void do not count."""
    classes, counted = len(labels.classes), truth != VOID
    pairs = truth[counted].astype(np.int64) * classes + guess[counted]
    matrix = np.bincount(pairs, minlength=classes**2).reshape(classes, classes).astype(float)
    hit, there, guessed = np.diag(matrix), matrix.sum(1), matrix.sum(0)
    with np.errstate(divide="ignore", invalid="ignore"):
        accuracy = np.where(there > 0, hit / there, np.nan)
        iou = np.where(there > 0, hit / (there + guessed - hit), np.nan)
    rows = zip(labels.classes, there / matrix.sum(), accuracy, iou, strict=True)
    each = tuple(ClassScore(name, float(p), float(a), float(i)) for name, p, a, i in rows)
    told = hit.sum() / matrix.sum(), np.nanmean(accuracy), np.nanmean(iou)
    of_pixels, of_classes, mean_iou = map(float, told)
    return ParsingScore(source, len(truth), of_pixels, of_classes, mean_iou, each)
