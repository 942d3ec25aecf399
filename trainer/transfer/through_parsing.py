"""Paper B's realistic translation network: virtual -> parsing -> real, two pix2pix in a row.

The first learns from the simulator's frames and labels, the second from photographs and what a
parser sees in them, or from another simulated world, which then stands for the real one (paper B,
section 3.2). Between the two each pixel becomes the nearest class's colour.
"""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import torch
from rich.console import Console
from torch import nn
from torch.nn import functional

from robot.camera.files import picture_files, read_picture
from robot.camera.source import fit_to_frame
from robot.contract import ImageSpec
from robot.errors import ConfigError
from robot.inference.preprocess import preprocess_batch
from robot.inference.translator import DIRECTIONS, TranslatorContract
from trainer.export import export_translator
from trainer.presets import preset
from trainer.transfer.classes import LABEL_SETS, ROAD, LabelSet
from trainer.transfer.cli import ThroughOptions
from trainer.transfer.labelled import load_pairs
from trainer.transfer.networks import as_bytes, as_floats, painted, through
from trainer.transfer.parser import Parser, load_parser
from trainer.transfer.pictures import SHEET_ROWS, draw_sheet, spread
from trainer.transfer.pix2pix import PIX2PIX, Pairs, Pix2Pix, fitted, teach_pairs

FRAME = (120, 160)  # height, width [px]


def translate_through(out: Path, run: ThroughOptions, console: Console) -> Path:
    """Do what is left of a run in the folder ``out``; the translator's path.

    ConfigError if the simulator's frames, the photographs or the parser do not fit.
    """
    image, labels = preset(run.task, "dueling", run.preset).image, LABEL_SETS[run.labels]
    virtual = _virtual(run.sim, image, labels)
    if run.parser:
        real = _real(Path(run.real), load_parser(Path(run.parser)), image)
    else:
        other = _virtual(run.real, image, labels)
        real = Pairs(other.wanted, other.given)
    to_parsing, to_real = (
        teach_pairs(
            Pix2Pix(fitted(PIX2PIX[run.net], image), run.seed),
            *(pairs, run.steps, run.seed, out / f"{name}.pt", console),
        )
        for name, pairs in (("virtual_to_parsing", virtual), ("parsing_to_real", real))
    )
    network, path = ThroughParsing(to_parsing, to_real, labels), out / "sim_to_real.onnx"
    name, notes = out.resolve().name, ("through parsing",)
    contract = TranslatorContract("pix2pix", DIRECTIONS[0], image, name, run.steps, notes=notes)
    export_translator(network, contract, path)
    chosen = spread(len(virtual.given), SHEET_ROWS)
    given = virtual.given[chosen]
    columns = {
        "input": given,
        "classes found": through(lambda some: as_bytes(network.parsed(some)), given),
        "true classes": virtual.wanted[chosen],
        "translation": through(network, given),
        "a photograph": real.wanted[spread(len(real.wanted), SHEET_ROWS)],
    }
    draw_sheet(out / "sheet.png", columns)
    return path


def _virtual(collection: str, image: ImageSpec, labels: LabelSet) -> Pairs:
    """A simulator's frames and their labels painted."""
    data = load_pairs(Path(collection), labels, FRAME)
    classes = _small(labels.paint(data.truth), labels, image)
    return Pairs(preprocess_batch(data.frames, image), classes)


def _real(photographs: Path, parser: Parser, image: ImageSpec) -> Pairs:
    """What a parser sees in photographs, painted, and the photographs."""
    if parser.labels is not ROAD:
        raise ConfigError(f"parser: expected one of labels road, got {parser.labels.name!r}")
    frames = np.stack([fit_to_frame(read_picture(path)) for path in picture_files(photographs)])
    seen = ROAD.paint(parser.parse(preprocess_batch(frames, parser.image)))
    whole = [cv2.resize(one, FRAME[::-1], interpolation=cv2.INTER_NEAREST) for one in seen]
    return Pairs(_small(np.stack(whole), ROAD, image), preprocess_batch(frames, image))


def _small(classes: np.ndarray, labels: LabelSet, image: ImageSpec) -> np.ndarray:
    """Painted classes as a policy's pictures: made small as frames are, lest thin lines vanish."""
    return labels.paint(labels.read(preprocess_batch(classes, image)))


class ThroughParsing(nn.Module):
    """Both networks as one: (N, H, W, 3) uint8 RGB -> the same; what is exported."""

    colours: torch.Tensor  # (C, 3) in [-1, 1]
    offsets: torch.Tensor  # (C,) their squared lengths

    def __init__(self, to_parsing: nn.Module, to_real: nn.Module, labels: LabelSet = ROAD) -> None:
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
