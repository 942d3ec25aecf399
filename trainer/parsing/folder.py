"""The folder of a parser: what it was taught with, its checkpoint, itself, its scores."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from robot.errors import ConfigError
from trainer.parsing.annotations import load_annotated, load_annotations
from trainer.parsing.classes import label_set
from trainer.parsing.labelled import Labelled, load_pairs, split_by_sequence
from trainer.parsing.train import ParseConfig
from trainer.run import CONFIG, begin_run, read_run


@dataclass(frozen=True)
class Sources:
    """Where labelled frames come from."""

    pairs: tuple[str, ...] = ()  # folders, see `load_pairs`
    annotations: str = ""  # a file of them, or the name of shipped ones
    photos: str = ""  # the folder of their photographs

    def load(self, config: ParseConfig) -> list[Split]:
        """The training and held-out frames of each source.

        Raises:
            ConfigError: no source, or one that does not hold what it should.
        """
        labels = label_set(config.labels)
        splits = []
        for folder in self.pairs:
            halves = split_by_sequence(load_pairs(Path(folder), labels, config.size))
            splits.append(Split(folder, *halves))
        if self.annotations:
            if not self.photos or config.labels != "road":
                raise ConfigError("annotations: expected --photos, and --labels road")
            drawn = load_annotations(self.annotations)
            halves = load_annotated(drawn, Path(self.photos), config.size)
            splits.append(Split(self.annotations, *halves))
        if not splits:
            raise ConfigError("parse: expected --pairs or --annotations with --photos, got none")
        return splits


@dataclass(frozen=True)
class Split:
    """One source."""

    name: str
    training: Labelled
    held_out: Labelled


@dataclass(frozen=True)
class ParseRun:
    """``config.yaml``."""

    parse: ParseConfig
    sources: Sources


class ParseFolder:
    """The paths of a run, and how it begins."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.config = path / CONFIG
        self.checkpoint = path / "checkpoint.pt"
        self.parser = path / "parser.pt"
        self.scores = path / "scores.json"
        self.sheet = path / "sheet.png"

    def begin(self, run: ParseRun) -> None:
        """Write ``config.yaml``; ConfigError if a run lies here already."""
        begin_run(self.path, run)

    def load(self) -> ParseRun:
        """What the run was begun with."""
        return read_run(ParseRun, self.path)
