"""The commands ``parse train``, ``parse choose`` and ``parse evaluate``."""

from __future__ import annotations

from dataclasses import asdict, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro
from rich.console import Console
from rich.table import Table

if TYPE_CHECKING:
    from trainer.parsing.folder import Split


Pairs = Annotated[tuple[Path, ...], tyro.conf.arg(name="pairs")]


def train_command(
    out: Path,
    labels: str = "road",
    pairs: Pairs = (),
    annotations: str = "",
    photos: Path | None = None,
    net: str = "small",
    size: tuple[int, int] = (120, 160),
    steps: int | None = None,
    batch: int | None = None,
    seed: int = 0,
    resume: bool = False,
) -> int:
    """Teach SegNet to label frames; leaves parser.pt, scores.json and sheet.png of held-out frames.

    Args:
        out: the run's folder; must not hold a run yet, unless --resume.
        labels: camvid (11 classes of full-size roads) or road (6 classes of a robot's road).
        pairs: folders with image/ and label/: CamVid's, or collections from the simulator.
        annotations: a file of labels drawn on photographs, or the name of a shipped one.
        photos: the folder of these photographs.
        net: small or paper.
        size: height and width of what the network sees [px].
        steps: updates.
        batch: frames in an update.
        seed: of everything random.
        resume: go on with the run in --out, if there is one, with its own configuration.
    """
    import torch

    from trainer.parsing.folder import ParseFolder, ParseRun, Sources
    from trainer.parsing.sheet import draw_sheet
    from trainer.parsing.train import ParseConfig, save_parser, teach

    torch.set_num_threads(1)
    folder = ParseFolder(out)
    if not (resume and folder.config.exists()):
        config = ParseConfig(labels, net, *size, seed=seed)
        config = replace(config, steps=steps or config.steps, batch=batch or config.batch)
        sources = Sources(tuple(map(str, pairs)), annotations, str(photos or ""))
        run = ParseRun(config, sources)
        run.sources.load(run.parse)  # refuse what does not fit before anything is written
        folder.begin(run)
    run = folder.load()
    splits = run.sources.load(run.parse)
    console = Console()
    sources_of_training = [split.training for split in splits]
    parser = teach(run.parse, sources_of_training, folder.checkpoint, console)
    save_parser(parser, folder.parser)
    draw_sheet(parser, splits[-1].held_out, folder.sheet)
    _report(folder.parser, splits, folder.scores, console)
    return 0


def choose_command(
    out: Path,
    pairs: Pairs = (),
    annotations: str = "",
    photos: Path | None = None,
    size: tuple[int, int] = (120, 160),
    steps: int = 600,
    seed: int = 0,
) -> int:
    """Ask training frames how much of the loss's favour for rare classes to take back in use.

    Args:
        out: folder for the parser that is asked and choice.json.
        pairs: as of train.
        annotations: as of train; what is chosen for comes last.
        photos: as of train.
        size: height and width of what the network sees [px].
        steps: updates.
        seed: of everything random.
    """
    import torch

    from robot.output import write_json
    from trainer.parsing.choose import choose_undone
    from trainer.parsing.folder import Sources
    from trainer.parsing.train import ParseConfig

    torch.set_num_threads(1)
    config = ParseConfig("road", "small", *size, steps=steps, seed=seed)
    splits = Sources(tuple(map(str, pairs)), annotations, str(photos or "")).load(config)
    out.mkdir(parents=True, exist_ok=True)
    sources = [split.training for split in splits]
    choice = choose_undone(config, sources, out / "checkpoint.pt", Console())
    write_json(out / "choice.json", asdict(choice))
    table = Table("taken back", "pixels right", "mean IoU")
    for share, found in choice.scores:
        table.add_row(f"{share:.2f}", f"{found.pixel_accuracy:.1%}", f"{found.mean_iou:.1%}")
    Console().print(table, f"best: {choice.best}")
    return 0


def evaluate_command(
    model: Path,
    pairs: Pairs = (),
    annotations: str = "",
    photos: Path | None = None,
    json: Path | None = None,
) -> int:
    """Score a parser on the held-out frames of each source, class by class.

    Args:
        model: a parser, .pt.
        pairs: as of train.
        annotations: as of train.
        photos: as of train.
        json: write the figures there.
    """
    from trainer.parsing.folder import Sources
    from trainer.parsing.train import load_parser

    sources = Sources(tuple(map(str, pairs)), annotations, str(photos or ""))
    _report(model, sources.load(load_parser(model).config), json, Console())
    return 0


def export_command(model: Path, out: Path) -> int:
    """Write a parser as a translator, whose pictures are the classes that it sees.

    Args:
        model: a parser, .pt.
        out: the file, .onnx: for --translate of train and evaluate, and the robot's translator.
    """
    from trainer.parsing.export import export_parser
    from trainer.parsing.train import load_parser

    export_parser(load_parser(model), model.resolve().parent.name, out)
    Console(soft_wrap=True).print(str(out))
    return 0


def translate_command(
    out: Path,
    sim: Path,
    real: Path,
    parser: Path | None = None,
    preset_name: Annotated[str, tyro.conf.arg(name="preset")] = "fast",
    task: str = "lane",
    labels: str = "road",
    virtual_labels: str = "true",
    net: str = "small",
    steps: int = 2000,
    seed: int = 0,
    resume: bool = False,
) -> int:
    """Teach virtual -> parsing -> real; leaves sim_to_real.onnx, a translator, and sheet.png.

    Args:
        out: the run's folder; must not hold a run yet, unless --resume.
        sim: a collection from the simulator.
        real: a folder of photographs, or a collection of another look that stands for them.
        parser: what labels photographs (python -m trainer parse train --labels road), .pt.
        preset_name: the pictures are those of the policies of this preset.
        task: and of this task.
        labels: road, or track for race tracks: kerbs, grass, walls and sky are told apart.
        virtual_labels: true (the simulator's own, as paper B) or parser (what the photographs'
            parser sees in the simulator: of the kind that the second network learns from).
        net: small or paper.
        steps: updates of each of the two networks.
        seed: of everything random.
        resume: go on with the run in --out, if there is one, with its own configuration.
    """
    import torch

    from trainer.parsing.translation_run import TranslationRun, begin, finish

    torch.set_num_threads(1)
    run = TranslationRun(
        sim=str(sim),
        real=str(real),
        parser=str(parser or ""),
        preset=preset_name,
        net=net,
        steps=steps,
        seed=seed,
        task=task,
        labels=labels,
        virtual_labels=virtual_labels,
    )
    path = finish(out, begin(out, run, resume), Console())
    Console(soft_wrap=True).print(str(path))
    return 0


def _report(model: Path, splits: list[Split], json: Path | None, console: Console) -> None:
    from trainer.parsing.train import evaluate, load_parser
    from trainer.run import write_json

    parser = load_parser(model)
    scores = [evaluate(parser, split.held_out, split.name) for split in splits]
    for score in scores:
        title = (
            f"{score.source}: mean IoU {score.mean_iou:.1%}, pixels {score.pixel_accuracy:.1%} "
            f"({score.frames} held-out frames)"
        )
        table = Table("class", "share of pixels", "accuracy", "IoU", title=title)
        for row in score.classes:
            figures = (f"{x:.1%}" for x in (row.pixels, row.accuracy, row.iou))
            table.add_row(row.name, *figures)
        console.print(table)
    if json is not None:
        write_json(json, scores)
