"""What a parser learns from, and the frames of it that are held out."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from robot.errors import ConfigError
from trainer.transfer.annotations import load_annotated, load_annotations
from trainer.transfer.classes import ROAD, LabelSet
from trainer.transfer.labelled import Labelled, load_pairs
from trainer.transfer.options import Sources

HELD_OUT_SHARE = 0.25  # of each sequence: its end, see `ends`


class Split(NamedTuple):
    """One source of labelled frames."""

    name: str
    training: Labelled
    held_out: Labelled


def load_sources(sources: Sources, labels: LabelSet, size: tuple[int, int]) -> list[Split]:
    """The training and held-out frames (height, width) of each source, annotated ones last.

    The last quarter of every sequence of pairs is held out. ConfigError if there is no source.
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


def ends(names: Sequence[str], share: float, fewest: int = 0) -> np.ndarray:
    """(N,) bool: what is held out, the last ``share`` of every sequence, for neighbours look alike.

    A sequence is what shares the name before the last underscore; names sort by time. At least
    ``fewest`` are held out of each, where that is not more than half of it.
    """
    chosen = np.zeros(len(names), bool)
    sequences: dict[str, list[int]] = {}
    for i, name in enumerate(names):
        sequences.setdefault(name.rpartition("_")[0], []).append(i)
    for members in sequences.values():
        members.sort(key=lambda i: names[i])
        count = max(round(share * len(members)), min(fewest, len(members) // 2))
        chosen[members[len(members) - count :]] = True
    return chosen
