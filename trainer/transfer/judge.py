"""How well a translator does: closer to photographs, and lines where they were.

Works for any translator file, whatever made it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from robot.inference.translator import OnnxTranslator
from trainer.transfer import metrics
from trainer.transfer.metrics import bright_lines, features, overlap, painted_lines
from trainer.transfer.pictures import load_paint, load_pictures
from trainer.transfer.validation import LANE_OVERLAP


@dataclass(frozen=True)
class Closeness:
    """Distances between two sets of pictures, see `trainer.transfer.metrics`."""

    kid: float
    fid: float


@dataclass(frozen=True)
class Judgement:
    """``--json`` of ``translate judge``."""

    translator: str
    pictures: int  # simulated, none of them trained with if the folders are others
    photographs: int
    before: Closeness  # simulated pictures from photographs
    after: Closeness  # translations from photographs
    photographs_apart: Closeness  # every second photograph from the others: as close as it gets
    lanes_kept: float  # overlap of the lines found in input and translation
    lanes_true: float  # of the lines found in the translation and those painted
    finder_true: float  # of the lines found in the input and those painted: the finder's own error
    keeps_lanes: bool  # lanes_kept >= LANE_OVERLAP


def judge(translator: OnnxTranslator, sim: Sequence[Path], real: Sequence[Path]) -> Judgement:
    """Measure a translator sim-to-real.

    Args:
        translator: the translator.
        sim: collections from the simulator.
        real: folders of photographs.

    Raises:
        ConfigError: a folder is absent, empty or without labels.
    """
    simulated, photographs = (load_pictures(paths, translator.image) for paths in (sim, real))
    paint = load_paint(simulated, translator.image)
    truth = painted_lines(paint)
    parts = range(0, len(paint), 32)
    translated = np.concatenate([translator(simulated.images[k : k + 32]) for k in parts])
    found, kept = bright_lines(simulated.images, paint), bright_lines(translated, paint)
    real_features = features(photographs.images)
    lanes_kept = overlap(kept, found)
    return Judgement(
        translator=str(translator.path),
        pictures=len(truth),
        photographs=len(real_features),
        before=_closeness(features(simulated.images), real_features),
        after=_closeness(features(translated), real_features),
        photographs_apart=_closeness(real_features[::2], real_features[1::2]),
        lanes_kept=lanes_kept,
        lanes_true=overlap(kept, truth),
        finder_true=overlap(found, truth),
        keeps_lanes=lanes_kept >= LANE_OVERLAP,
    )


def _closeness(made: np.ndarray, real: np.ndarray) -> Closeness:
    return Closeness(metrics.kernel_distance(made, real), metrics.frechet_distance(made, real))
