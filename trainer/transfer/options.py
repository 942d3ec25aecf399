"""What the trainings of parsers and of translations through parsing can be asked for.

Each is the ``config.yaml`` of a run, too. Imports nothing heavy: ``--help`` needs these.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from robot.errors import ConfigError, nearest

NETS = ("paper", "small")  # of SegNet and of pix2pix


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
    labels: str = "road"  # camvid (11 classes of full-size roads), road (6) or track (7).
    net: str = "small"  # small or paper.
    size: tuple[int, int] = (120, 160)  # Height and width of what the network sees [px].
    steps: int = 2000  # Updates.
    batch: int = 8  # Frames in an update.
    seed: int = 0  # Of everything random.

    def __post_init__(self) -> None:
        _known("net", self.net, NETS)


@dataclass(frozen=True)
class ThroughOptions:
    """How a translation through parsing is taught."""

    sim: str  # A collection from the simulator.
    real: str  # A folder of photographs, or a collection of another look that stands for them.
    parser: str = ""  # What labels photographs (python -m trainer parse train --labels road), .pt.
    preset: str = "fast"  # The pictures are those of the policies of this preset.
    net: str = "small"  # small or paper.
    steps: int = 2000  # Updates of each of the two networks.
    seed: int = 0  # Of everything random.
    task: str = "lane"  # Of the policies whose pictures these are.
    labels: str = "road"  # road, or track, which tells kerbs, grass, walls and sky apart.

    def __post_init__(self) -> None:
        _known("net", self.net, NETS)
        if bool(self.parser) == is_collection(Path(self.real)):
            raise ConfigError(
                f"parser: expected one for photographs and none for a collection, got "
                f"{self.parser or 'none'} for {self.real}"
            )
        _known("labels", self.labels, ("road",) if self.parser else ("road", "track"))


def is_collection(folder: Path) -> bool:
    """Whether the simulator's frames and labels lie there (``python -m trainer collect``)."""
    return (folder / "collection.yaml").exists() and (folder / "label").is_dir()


def _known(what: str, name: str, valid: tuple[str, ...]) -> None:
    if name not in valid:
        raise ConfigError(f"{what}: unknown {name!r}; {nearest(name, valid)}")
