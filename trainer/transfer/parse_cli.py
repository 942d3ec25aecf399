"""The commands of ``parse``."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro
from rich.console import Console
from rich.table import Table

from trainer.transfer.options import ParseOptions, Sources, ThroughOptions

if TYPE_CHECKING:
    from trainer.transfer.labelled import Split
    from trainer.transfer.parser import Parser

_TRAIN, _NOWHERE = ParseOptions(), Sources()


def train_command(
    out: Path,
    options: Annotated[ParseOptions, tyro.conf.arg(name="")] = _TRAIN,
    resume: bool = False,
) -> int:
    """Teach SegNet to label frames; leaves parser.pt, scores.json and sheet.png of held-out frames.

    Args:
        out: the run's folder; must not hold a run yet, unless --resume.
        options: what from, and how.
        resume: go on with the run in --out, if there is one, with its own configuration.
    """
    import torch

    from trainer.run import take_up
    from trainer.transfer.classes import label_set
    from trainer.transfer.labelled import load_sources
    from trainer.transfer.parser import save_parser, teach
    from trainer.transfer.pictures import SHEET_ROWS, draw_sheet, spread

    torch.set_num_threads(1)

    def fresh() -> ParseOptions:
        # refused before anything is written
        load_sources(options.sources, label_set(options.labels), options.size)
        return options

    run, console = take_up(ParseOptions, out, resume, fresh), Console()
    splits = load_sources(run.sources, label_set(run.labels), run.size)
    training = [split.training for split in splits]
    parser = teach(run, training, out / "checkpoint.pt", console)
    save_parser(parser, out / "parser.pt")
    held_out = splits[-1].held_out
    shown = held_out.pick(spread(len(held_out), min(SHEET_ROWS, len(held_out))))
    found, true = (parser.labels.paint(each) for each in (parser(shown.frames), shown.truth))
    columns = {"frame": shown.frames, "classes found": found, "true classes": true}
    draw_sheet(out / "sheet.png", columns)
    _report(parser, splits, out / "scores.json", console)
    return 0


def evaluate_command(
    model: Path,
    sources: Annotated[Sources, tyro.conf.arg(name="")] = _NOWHERE,
    json: Path | None = None,
) -> int:
    """Score a parser on the held-out frames of each source, class by class.

    Args:
        model: a parser, .pt.
        sources: as of train.
        json: write the figures there.
    """
    from trainer.transfer.labelled import load_sources
    from trainer.transfer.parser import load_parser

    parser = load_parser(model)
    _report(parser, load_sources(sources, parser.labels, parser.options.size), json, Console())
    return 0


def export_command(model: Path, out: Path) -> int:
    """Write a parser as a translator, whose pictures are the classes that it sees.

    Args:
        model: a parser, .pt.
        out: the file, .onnx: for --translate of train and evaluate, and the robot's translator.
    """
    from trainer.transfer.parser import load_parser

    load_parser(model).export(model.resolve().parent.name, out)
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
    from trainer.transfer.metrics import score_classes

    scores = []
    for split in splits:
        found = parser(split.held_out.frames)
        score = score_classes(split.held_out.truth, found, parser.labels, split.name)
        scores.append(score)
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
