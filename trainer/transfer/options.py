"""What the trainings of parsers and of translations through parsing can be asked for.

Each is the ``config.yaml`` of a run, too. Imports nothing heavy: ``--help`` needs these.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import tyro

from robot.errors import ConfigError


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
    parser: str = ""  # What labels photographs (python -m trainer parse train --labels road), .pt.
    preset: str = "fast"  # The pictures are those of the policies of this preset.
    net: Literal["small", "paper"] = "small"  # Of pix2pix.
    steps: int = 2000  # Updates of each of the two networks.
    seed: int = 0  # Of everything random.
    task: str = "lane"  # Of the policies whose pictures these are.
    labels: Literal["road", "track"] = "road"  # The latter tells kerbs, grass, walls, sky apart.

    def __post_init__(self) -> None:
        if bool(self.parser) == is_collection(Path(self.real)):
            raise ConfigError(
                f"parser: expected one for photographs and none for a collection, got "
                f"{self.parser or 'none'} for {self.real}"
            )
        if self.parser and self.labels != "road":
            raise ConfigError(f"labels: expected road with a parser, got {self.labels}")


def is_collection(folder: Path) -> bool:
    """Whether the simulator's frames and labels lie there (``python -m trainer collect``)."""
    return (folder / "collection.yaml").exists() and (folder / "label").is_dir()
