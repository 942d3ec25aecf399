"""A run of the translation through parsing: its folder, both trainings, the exported file."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from rich.console import Console

from robot.errors import ConfigError, nearest
from robot.inference.translator import DIRECTIONS, TranslatorContract
from trainer.parsing.classes import label_set
from trainer.parsing.labelled import is_collection
from trainer.parsing.pix2pix import PIX2PIX, Pix2Pix, UNet, fitted
from trainer.parsing.sheet import write_png
from trainer.parsing.through_parsing import (
    Pairs,
    ThroughParsing,
    as_bytes,
    real_pairs,
    teach_pairs,
    virtual_pairs,
)
from trainer.parsing.train import load_parser
from trainer.presets import preset
from trainer.run import CONFIG, begin_run, read_run
from trainer.translation.export import export_translator

ROWS = 6


@dataclass(frozen=True)
class TranslationRun:
    """``config.yaml``."""

    sim: str  # a collection
    real: str  # a folder of photographs, or a collection that stands for them
    parser: str  # of the photographs, its file
    preset: str
    net: str
    steps: int
    seed: int
    task: str = "lane"  # of the policies whose pictures these are
    labels: str = "road"
    virtual_labels: str = "true"  # or parser: as the photographs' parser sees the simulator

    def __post_init__(self) -> None:
        if self.net not in PIX2PIX:
            raise ConfigError(f"net: unknown {self.net!r}; {nearest(self.net, PIX2PIX)}")
        if bool(self.parser) == is_collection(Path(self.real)):
            raise ConfigError(
                f"parser: expected one for photographs and none for a collection, got "
                f"{self.parser or 'none'} for {self.real}"
            )
        if self.parser and self.labels != "road":
            raise ConfigError(
                f"labels: expected road, which parsers see in photographs, got {self.labels!r}"
            )
        wanted = ("true", "parser") if self.parser else ("true",)
        if self.virtual_labels not in wanted:
            raise ConfigError(
                f"virtual_labels: expected one of {', '.join(wanted)}, got {self.virtual_labels!r}"
            )


def begin(out: Path, run: TranslationRun, resume: bool) -> TranslationRun:
    """Write ``config.yaml``, or read that of the run to go on with.

    Raises:
        ConfigError: a run lies here and it is not to be resumed.
    """
    if resume and (out / CONFIG).exists():
        return read_run(TranslationRun, out)
    begin_run(out, run)
    return run


def finish(out: Path, run: TranslationRun, console: Console) -> Path:
    """Do what is left of a run; the translator's path.

    Raises:
        ConfigError: the simulator's frames, the photographs or the parser do not fit.
        ContractError: torch and ONNX disagree.
    """
    image, labels = preset(run.task, "dueling", run.preset).image, label_set(run.labels)
    net = fitted(PIX2PIX[run.net], image)
    parser = load_parser(Path(run.parser)) if run.parser else None
    sees = parser if run.virtual_labels == "parser" else None
    virtual = virtual_pairs(Path(run.sim), image, labels, sees)
    if parser is not None:
        real = real_pairs(Path(run.real), parser, image)
    else:
        real = virtual_pairs(Path(run.real), image, labels).reversed()

    def taught(name: str, pairs: Pairs) -> UNet:
        model = Pix2Pix(net, run.seed)
        return teach_pairs(model, pairs, run.steps, run.seed, out / f"{name}.pt", console)

    to_parsing = taught("virtual_to_parsing", virtual)
    network = ThroughParsing(to_parsing, taught("parsing_to_real", real), labels)
    contract = TranslatorContract(
        "pix2pix", DIRECTIONS[0], image, out.resolve().name, run.steps, notes=("through parsing",)
    )
    path = out / "sim_to_real.onnx"
    export_translator(network, contract, path)
    write_png(out / "sheet.png", sheet(network, virtual, real))
    return path


@torch.no_grad()
def sheet(network: ThroughParsing, virtual: Pairs, real: Pairs) -> np.ndarray:
    """Rows of picture, its classes found, its true classes, translation, some photograph."""
    chosen = np.linspace(0, len(virtual.given) - 1, ROWS).astype(int)
    given = torch.from_numpy(virtual.given[chosen])
    found = as_bytes(network.parsed(given)).numpy()
    photographs = real.wanted[np.linspace(0, len(real.wanted) - 1, ROWS).astype(int)]
    columns = (virtual.given[chosen], found, virtual.wanted[chosen], network(given).numpy())
    rows = [np.hstack(row) for row in zip(*columns, photographs, strict=True)]
    return np.repeat(np.repeat(np.vstack(rows), 2, axis=0), 2, axis=1)
