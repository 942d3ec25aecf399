"""A run is a folder: every file that a training leaves, each written whole or not at all."""

import csv
import shutil
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

from robot.errors import ConfigError
from robot.output import atomically, expect_folder, write_yaml
from robot.typed_config import from_plain, load_yaml, read_yaml
from trainer.algorithms import find_algorithm
from trainer.config import RunConfig

CONFIG = "config.yaml"  # of every kind of run: what it was begun with
Config = TypeVar("Config")


@contextmanager
def appearing(folder: Path) -> Iterator[Path]:
    """A folder to fill, which gets its name once it is whole; what a kill left is taken away.

    ConfigError where there is something of that name.
    """
    if folder.exists():
        raise ConfigError(f"{folder}: expected a new folder, there is one; choose another name")
    expect_folder(folder.parent)
    hidden = folder.with_name(f".{folder.name}.partial")
    shutil.rmtree(hidden, ignore_errors=True)
    hidden.mkdir(parents=True)
    try:
        yield hidden
        hidden.rename(folder)
    finally:
        shutil.rmtree(hidden, ignore_errors=True)


def refuse_run(folder: Path) -> None:
    """ConfigError if a run lies in a folder."""
    if any((folder / name).exists() for name in (CONFIG, "model.onnx")):
        raise ConfigError(
            f"{folder}: expected no run here yet, got one; "
            "add --resume to go on with it, or choose another --out"
        )


def take_up(kind: type[Config], folder: Path, resume: bool, fresh: Callable[[], Config]) -> Config:
    """The configuration of a run to resume, or that of one that is begun here.

    ConfigError if a run lies here and it is not to be resumed.
    """
    if resume and (folder / CONFIG).exists():
        return load_yaml(kind, folder / CONFIG)
    refuse_run(folder)
    config = fresh()
    write_yaml(folder / CONFIG, config)
    return config


class Episode(NamedTuple):
    """One line of ``progress.csv``."""

    step: int  # decisions of all robots together when it ended
    seconds: float  # of training until then
    robot: int
    reward: float  # summed
    length: int  # decisions
    success: bool


_READ: tuple[Callable[[str], Any], ...] = (int, float, int, float, int, "1".__eq__)


class RunFolder:
    """The paths of a run, and how each is written."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.config = path / CONFIG
        self.checkpoint = path / "checkpoint.pt"
        self.best = path / "best.pt"
        self.coach = path / "coach.pt"
        self.replay = path / "replay"
        self.progress = path / "progress.csv"
        self.curve = path / "curve.png"
        self.film = path / "evaluation.mp4"  # what a robot of the latest evaluation saw
        self.onnx = path / "model.onnx"
        self.onnx_int8 = path / "model_int8.onnx"
        self.exported = path / "export.json"
        self.metrics = path / "metrics.json"
        self.tensorboard = path / "tensorboard"

    def refuse_another(self, config: RunConfig) -> None:
        """ConfigError if a run lies here that differs in more than its limits."""
        if not self.config.exists():
            return
        found = self.load_config()
        config = replace(config, steps=found.steps, seconds=found.seconds)
        other = [name for name, value in vars(found).items() if value != getattr(config, name)]
        if other:
            raise ConfigError(
                f"{self.path}: expected a run with the options asked for, got another "
                f"{', '.join(other)}; ask as {self.config.name} says, or choose another --out"
            )

    def go_on(self, config: RunConfig) -> None:
        """Begin a run here, or give the one that lies here new limits; errors as above."""
        self.refuse_another(config)
        write_yaml(self.config, config)

    def load_config(self) -> RunConfig:
        """The configuration that this run was begun with; ConfigError if it is absent or wrong."""
        if not self.config.exists():
            raise ConfigError(f"{self.path}: expected the folder of a run, found no {CONFIG}")
        plain = read_yaml(self.config)
        if not (isinstance(plain, dict) and isinstance(plain.get("algorithm"), str)):
            raise ConfigError(f"{self.config}: expected the configuration of a training, got none")
        usual = find_algorithm(plain["algorithm"]).learn  # has fields that others have not
        learn = from_plain(type(usual), plain.pop("learn", {}), f"{self.config}.learn")
        found = from_plain(RunConfig, {**plain, "learn": {}}, str(self.config))
        return replace(found, learn=learn)

    def episodes(self) -> list[Episode]:
        """All of ``progress.csv``."""
        if not self.progress.exists():
            return []
        with self.progress.open(newline="", encoding="utf-8") as file:
            rows = [row for row in [*csv.reader(file)][1:] if len(row) == len(_READ)]
        try:
            return [Episode(*(read(v) for read, v in zip(_READ, row, strict=True))) for row in rows]
        except ValueError as error:
            raise ConfigError(f"{self.progress}: expected numbers, got: {error}") from error


class EpisodeLog:
    """Appends to ``progress.csv``; a run taken up again drops what came after its checkpoint."""

    def __init__(self, folder: RunFolder, resumed_at: int = 0) -> None:
        kept = [episode for episode in folder.episodes() if episode.step <= resumed_at]
        with atomically(folder.progress) as temporary, temporary.open("w", newline="") as file:
            writer = csv.writer(file)
            writer.writerow(Episode._fields)
            writer.writerows(_row(episode) for episode in kept)
        self.count = len(kept)
        self.file = folder.progress.open("a", newline="", encoding="utf-8")

    def add(self, episode: Episode) -> None:
        """One line; on disk once the file is flushed or closed."""
        csv.writer(self.file).writerow(_row(episode))
        self.count += 1


def _row(e: Episode) -> tuple[object, ...]:
    return (e.step, f"{e.seconds:.2f}", e.robot, f"{e.reward:.4f}", e.length, int(e.success))
