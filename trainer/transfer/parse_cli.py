"""The commands of ``parse``."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro
from rich.console import Console
from rich.table import Table

from trainer.transfer.options import Sources, ThroughOptions

if TYPE_CHECKING:
    from trainer.transfer.annotations import Split
    from trainer.transfer.parser import Parser

Labels = Annotated[Sources, tyro.conf.arg(name="")]
_NOWHERE = Sources()


def train_command(
    out: Path,
    labels: str = "road",
    sources: Labels = _NOWHERE,
    net: str = "small",
    size: tuple[int, int] = (120, 160),
    steps: int = 2000,
    batch: int = 8,
    seed: int = 0,
    resume: bool = False,
) -> int:
    """Teach SegNet to label frames; leaves parser.pt, scores.json and sheet.png of held-out frames.

    Args:
        out: the run's folder; must not hold a run yet, unless --resume.
        labels: camvid (11 classes of full-size roads) or road (6 classes of a robot's road).
        sources: what it learns from.
        net: small or paper.
        size: height and width of what the network sees [px].
        steps: updates.
        batch: frames in an update.
        seed: of everything random.
        resume: go on with the run in --out, if there is one, with its own configuration.
    """
    import torch

    from trainer.run import take_up
    from trainer.transfer.annotations import load_sources
    from trainer.transfer.parser import ParseConfig, ParseRun, draw_parsed, save_parser, teach

    torch.set_num_threads(1)

    def fresh() -> ParseRun:
        config = ParseConfig(labels, net, *size, steps=steps, batch=batch, seed=seed)
        load_sources(sources, config.label_set, config.size)  # refused before anything is written
        return ParseRun(config, sources)

    run = take_up(ParseRun, out, resume, fresh)
    splits = load_sources(run.sources, run.parse.label_set, run.parse.size)
    console = Console()
    training = [split.training for split in splits]
    parser = teach(run.parse, training, out / "checkpoint.pt", console)
    save_parser(parser, out / "parser.pt")
    draw_parsed(parser, splits[-1].held_out, out / "sheet.png")
    _report(parser, splits, out / "scores.json", console)
    return 0


def evaluate_command(model: Path, sources: Labels = _NOWHERE, json: Path | None = None) -> int:
    """Score a parser on the held-out frames of each source, class by class.

    Args:
        model: a parser, .pt.
        sources: as of train.
        json: write the figures there.
    """
    from trainer.transfer.annotations import load_sources
    from trainer.transfer.parser import load_parser

    parser = load_parser(model)
    splits = load_sources(sources, parser.labels, parser.config.size)
    _report(parser, splits, json, Console())
    return 0


def export_command(model: Path, out: Path) -> int:
    """Write a parser as a translator, whose pictures are the classes that it sees.

    Args:
        model: a parser, .pt.
        out: the file, .onnx: for --translate of train and evaluate, and the robot's translator.
    """
    from trainer.transfer.export import export_parser
    from trainer.transfer.parser import load_parser

    export_parser(load_parser(model), model.resolve().parent.name, out)
    Console(soft_wrap=True).print(str(out))
    return 0


def through_command(
    out: Path, options: Annotated[ThroughOptions, tyro.conf.arg(name="")], resume: bool = False
) -> int:
    """Teach virtual -> parsing -> real; leaves sim_to_real.onnx, a translator, and sheet.png.

    Args:
        out: the run's folder; must not hold a run yet, unless --resume.
        options: what from, and how.
        resume: go on with the run in --out, if there is one, with its own configuration.
    """
    import torch

    from trainer.run import take_up
    from trainer.transfer.through_parsing import translate_through

    torch.set_num_threads(1)
    run = take_up(ThroughOptions, out, resume, lambda: options)
    Console(soft_wrap=True).print(str(translate_through(out, run, Console())))
    return 0


def _report(parser: Parser, splits: Sequence[Split], json: Path | None, console: Console) -> None:
    from trainer.run import write_json
    from trainer.transfer.parser import evaluate

    scores = [evaluate(parser, split.held_out, split.name) for split in splits]
    for score in scores:
        title = (
            f"{score.source}: mean IoU {score.mean_iou:.1%}, pixels {score.pixel_accuracy:.1%} "
            f"({score.frames} held-out frames)"
        )
        table = Table("class", "share of pixels", "accuracy", "IoU", title=title)
        for row in score.classes:
            table.add_row(row.name, *(f"{x:.1%}" for x in (row.pixels, row.accuracy, row.iou)))
        console.print(table)
    if json is not None:
        write_json(json, scores)
