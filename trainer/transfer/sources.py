"""What a parser learns from, and the frames of it that are held out."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np

from robot.errors import ConfigError
from trainer.sequences import ends
from trainer.transfer.annotations import load_annotated, load_annotations
from trainer.transfer.classes import ROAD, LabelSet
from trainer.transfer.labelled import Labelled, load_pairs
from trainer.transfer.options import Sources

HELD_OUT_SHARE = 0.25  # of each sequence: its end, see `trainer.sequences`


class Split(NamedTuple):
    """One source of labelled frames."""

    name: str
    training: Labelled
    held_out: Labelled


def load_sources(sources: Sources, labels: LabelSet, size: tuple[int, int]) -> list[Split]:
    """The training and held-out frames (height, width) of each source, annotated ones last.

    The last quarter of every sequence of pairs is held out.

    Raises:
        ConfigError: no source, or one that does not hold what it should.
    """
    splits = []
    for folder in sources.pairs:
        data = load_pairs(Path(folder), labels, size)
        held = ends(data.names, HELD_OUT_SHARE)
        splits.append(Split(folder, data.pick(np.flatnonzero(~held)), data.pick(held.nonzero()[0])))
    if sources.annotations:
        if not sources.photos or labels is not ROAD:
            raise ConfigError("annotations: expected --photos, and --labels road")
        drawn = load_annotations(sources.annotations)
        halves = load_annotated(drawn, Path(sources.photos), size)
        splits.append(Split(sources.annotations, *halves))
    if not splits:
        raise ConfigError("parse: expected --pairs or --annotations with --photos, got none")
    return splits
