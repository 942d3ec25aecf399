"""The commands ``collect``, ``translate`` and ``parse``, and what trainings can be asked for.

Imports nothing heavy: ``--help`` needs these.
"""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any, Literal

import tyro
from rich.console import Console

from robot.errors import ConfigError, expect_between

_NEW = "the run's folder; must not hold a run yet, unless --resume."
_ON = "go on with the run in --out, if there is one, with its own configuration."
NewRun = Annotated[Path, tyro.conf.arg(help=_NEW)]
Resume = Annotated[bool, tyro.conf.arg(help=_ON)]


@dataclass(frozen=True)
class Source:
    """Which frames are gathered; ``collection.yaml``."""

    # Map or track files, or names of shipped ones; not both kinds.
    maps: Annotated[tuple[str, ...], tyro.conf.arg(name="map")] = ("loop", "town")
    frames: int = 2000  # How many.
    look: str = "randomised"  # A look or a distribution of looks, a file or a shipped name.
    seed: int = 0  # Of everything random.


@dataclass(frozen=True)
class Sources:
    """Where labelled frames come from."""

    pairs: tuple[str, ...] = ()  # Folders with image/ and label/: CamVid's, or collections.
    annotations: str = ""  # A file of labels drawn on photographs, or the name of a shipped one.
    photos: str = ""  # The folder of these photographs.


@dataclass(frozen=True)
class ParseOptions:
    """How a parser is taught."""

    sources: Annotated[Sources, tyro.conf.arg(name="")] = Sources()  # What it learns from.
    labels: Literal["camvid", "road", "track"] = "road"  # 11 classes of full-size roads, 6, or 7.
    net: Literal["small", "paper"] = "small"  # Of SegNet.
    size: tuple[int, int] = (120, 160)  # Height and width of what the network sees [px].
    steps: int = 2000  # Updates.
    batch: int = 8  # Frames in an update.
    seed: int = 0  # Of everything random.


@dataclass(frozen=True)
class ThroughOptions:
    """How a translation through parsing is taught."""

    sim: str  # A collection from the simulator.
    real: str  # A folder of photographs, or a collection of another look that stands for them.
    parser: str = ""  # What labels photographs (duckpilot parse train --labels road), .pt.
    preset: str = "fast"  # The pictures are those of the policies of this preset.
    net: Literal["small", "paper"] = "small"  # Of pix2pix.
    steps: int = 2000  # Updates of each of the two networks.
    seed: int = 0  # Of everything random.
    task: str = "lane"  # Of the policies whose pictures these are.
    labels: Literal["road", "track"] = "road"  # The latter tells kerbs, grass, walls, sky apart.

    def __post_init__(self) -> None:
        if bool(self.parser) == is_collection(Path(self.real)):
            told = "parser: expected one for photographs and none for a collection, got "
            raise ConfigError(f"{told}{self.parser or 'none'} for {self.real}")
        if self.parser and self.labels != "road":
            raise ConfigError(f"labels: expected road with a parser, got {self.labels}")


def is_collection(folder: Path) -> bool:
    """Whether the simulator's frames and labels lie there (``duckpilot collect``)."""
    return (folder / "collection.yaml").exists()


def collect_command(out: Path, source: Annotated[Source, tyro.conf.arg(name="")]) -> int:
    """Gather frames with their labels from the simulator.

    Args:
        out: a folder that does not exist yet; gets image/ and label/.
    """
    from trainer.transfer.pictures import collect

    collect(out, source)
    _say(f"{out}: {source.frames} frames")
    return 0


def translate_train_command(
    out: NewRun,
    sim: tuple[Path, ...] = (),
    real: tuple[Path, ...] = (),
    preset: str = "fast",
    steps: int | None = None,
    structure: float | None = None,
    seed: int = 0,
    resume: Resume = False,
) -> int:
    """Train CycleGAN between simulator and photographs; leaves both translators, and sheet.png.

    Tells at last, of the pictures that it learned from, what `translate judge` tells of others.

    Args:
        sim: collections from the simulator (duckpilot collect).
        real: folders of photographs, videos or robots' recordings (.mcap); each is drawn from
            equally often.
        preset: fast (80x40), paper (160x120) or debug.
        steps: updates, in place of the preset's.
        structure: weight of keeping painted lines in place; 0 is plain CycleGAN.
        seed: of everything random.
    """
    from trainer.run import take_up
    from trainer.transfer import cyclegan

    def fresh() -> cyclegan.TranslationConfig:
        if not sim or not real:
            raise ConfigError("translate train: expected --sim and --real folders, got none")
        config = cyclegan.translation_preset(preset, tuple(map(str, sim)), tuple(map(str, real)))
        cyclegan.UnpairedPictures(config, "cpu")  # refused before anything is written
        given: dict[str, Any] = {"steps": steps, "structure": structure}
        asked = {name: value for name, value in given.items() if value is not None}
        return replace(config, seed=seed, **asked)

    config = take_up(cyclegan.TranslationConfig, out, resume, fresh)
    model = cyclegan.train_translation(out, config, Console())
    learned, photographs = (tuple(map(Path, some)) for some in (config.sim, config.real))
    return translate_judge_command(model, learned, photographs)


def translate_judge_command(
    model: Path, sim: tuple[Path, ...], real: tuple[Path, ...], json: Path | None = None
) -> int:
    """How near a translator sim-to-real comes to photographs, and what it keeps of painted lines.

    Args:
        model: a translator, .onnx.
        sim: collections from the simulator, best none that it was trained with.
        real: as of train.
        json: write the figures there.
    """
    from robot.inference.policy import OnnxTranslator
    from robot.output import write_json
    from trainer.transfer.judge import LANE_OVERLAP, judge

    found = judge(OnnxTranslator(model), sim, real)
    if json is not None:
        write_json(json, found)
    _say(
        f"{model}: lanes kept {found['lanes_kept']:.3f} (at least {LANE_OVERLAP} is due), "
        f"colours {found['colours_before']:.1f} -> {found['colours_after']:.1f} grey levels off "
        f"(photographs from each other {found['colours_apart']:.1f})"
    )
    return 0


def parse_train_command(
    out: NewRun, options: Annotated[ParseOptions, tyro.conf.arg(name="")], resume: Resume = False
) -> int:
    """Teach SegNet to label frames; leaves parser.pt, scores.json, sheet.png of held-out frames."""
    from trainer.run import take_up
    from trainer.transfer.labelled import load_sources
    from trainer.transfer.parser import train_parser

    def fresh() -> ParseOptions:
        for length in options.size:  # halved four times, or five
            expect_between("size", length, 16 if options.net == "small" else 32, 10_000)
        load_sources(options)  # refused before anything is written
        return options

    train_parser(out, take_up(ParseOptions, out, resume, fresh), Console())
    return 0


def parse_export_command(model: Path, out: Path) -> int:
    """Write a parser as a translator, whose pictures are the classes that it sees.

    Args:
        model: a parser, .pt.
        out: the file, .onnx: for --translate of train and evaluate, and the robot's translator.
    """
    from trainer.transfer.parser import load_parser

    load_parser(model).export(model.resolve().parent.name, out)
    _say(out)
    return 0


def parse_translate_command(
    out: NewRun, options: Annotated[ThroughOptions, tyro.conf.arg(name="")], resume: Resume = False
) -> int:
    """Teach virtual -> parsing -> real; leaves sim_to_real.onnx, a translator, and sheet.png."""
    from trainer.run import take_up
    from trainer.transfer.pix2pix import both_pairs, translate_through

    def fresh() -> ThroughOptions:
        both_pairs(options)  # refused before anything is written
        return options

    _say(translate_through(out, take_up(ThroughOptions, out, resume, fresh), Console()))
    return 0


def _say(line: object) -> None:
    Console(soft_wrap=True).print(str(line), markup=False)
