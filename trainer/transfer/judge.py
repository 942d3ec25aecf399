"""How well a translator does: closer to photographs, and lines where they were.

Works for any translator file, whatever made it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from robot.inference.translator import DIRECTIONS, OnnxTranslator
from trainer.transfer import metrics
from trainer.transfer.metrics import any_line, features, overlap
from trainer.transfer.pictures import load_paint, load_pictures, spread
from trainer.transfer.sheet import draw_sheet
from trainer.transfer.unpaired import onnx_file
from trainer.transfer.validation import LANE_OVERLAP

# Pictures (N, H, W, 3) and their paint (N, 4, H, W) -> masks (N, H, W), not 0 on lines.
FindLines = Callable[[np.ndarray, np.ndarray], np.ndarray]


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


def judge(
    translator: OnnxTranslator, sim: Sequence[Path], real: Sequence[Path], find: FindLines
) -> Judgement:
    """Measure a translator sim-to-real.

    Args:
        translator: the translator.
        sim: collections from the simulator.
        real: folders of photographs.
        find: finds painted lines, in pictures and translations alike.

    Raises:
        ConfigError: a folder is absent, empty or without labels.
    """
    simulated, photographs = (load_pictures(paths, translator.image) for paths in (sim, real))
    paint = load_paint(simulated, translator.image)
    truth = any_line(paint)
    parts = range(0, len(paint), 32)
    translated = np.concatenate([translator(simulated.images[k : k + 32]) for k in parts])
    found, kept = find(simulated.images, paint), find(translated, paint)
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


def draw_run(
    path: Path, run: Path, sim: Sequence[Path], real: Sequence[Path], rows: int
) -> list[Path]:
    """Columns: picture, translation, cycle and, with photographs, the nearest of them.

    Args:
        path: a PNG file.
        run: the folder of a run whose translators were exported.
        sim: collections from the simulator.
        real: folders of photographs, to look for the nearest one by the features of the distances.
        rows: how many pictures.

    Returns:
        The files of the nearest photographs, one for each row; none without photographs.
    """
    there, back = (OnnxTranslator(onnx_file(run, direction)) for direction in DIRECTIONS)
    pictures = load_pictures(sim, there.image)
    given = pictures.images[spread(len(pictures.images), rows)]
    translated, files = there(given), list[Path]()
    columns = {"input": given, "translation": translated, "cycle": back(translated)}
    if real:
        photographs = load_pictures(real, there.image)
        nearest = _nearest(translated, photographs.images)
        columns["nearest photograph"] = photographs.images[nearest]
        files = [photographs.files[k] for k in nearest]
    draw_sheet(path, columns)
    return files


def _nearest(pictures: np.ndarray, photographs: np.ndarray) -> list[int]:
    real = features(photographs)
    mean, deviation = real.mean(0), real.std(0) + 1e-6
    ours, theirs = (features(pictures) - mean) / deviation, (real - mean) / deviation
    return [int(np.square(theirs - row).sum(1).argmin()) for row in ours]


def _closeness(made: np.ndarray, real: np.ndarray) -> Closeness:
    return Closeness(metrics.kernel_distance(made, real), metrics.frechet_distance(made, real))
