"""How well a translator does: closer to photographs, and lines where they were.

Works for any translator file, whatever made it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from robot.inference.translator import OnnxTranslator
from trainer.run import atomically
from trainer.translation.distance import features, frechet_distance, kernel_distance
from trainer.translation.lanes import overlap, true_masks
from trainer.translation.pictures import Pictures, load_paint, load_pictures
from trainer.translation.validation import LANE_OVERLAP

# Pictures (N, H, W, 3) and their paint (N, 4, H, W) -> masks (N, H, W), not 0 on lines.
FindLines = Callable[[np.ndarray, np.ndarray], np.ndarray]
_ENLARGED = 2
_GAP = 4


@dataclass(frozen=True)
class Closeness:
    """Distances between two sets of pictures, see `trainer.translation.distance`."""

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
    truth = true_masks(paint)
    translated = in_parts(translator, simulated.images)
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


def in_parts(translator: OnnxTranslator, pictures: np.ndarray, size: int = 32) -> np.ndarray:
    """Translations of many pictures (N, H, W, 3)."""
    starts = range(0, len(pictures), size)
    return np.concatenate([translator(pictures[k : k + size]) for k in starts])


def draw_sheet(
    path: Path,
    there: OnnxTranslator,
    back: OnnxTranslator,
    pictures: np.ndarray,
    photographs: Pictures | None = None,
) -> tuple[Path, ...]:
    """Columns: picture, translation, cycle and, with photographs, the nearest of them.

    Args:
        path: a PNG file.
        there: translates the pictures.
        back: translates them back.
        pictures: (N, H, W, 3), one row each.
        photographs: to look for the nearest one, by the features of the distances.

    Returns:
        The files of the nearest photographs, one for each row; none without photographs.
    """
    files: tuple[Path, ...] = ()
    translated = there(pictures)
    columns = {"input": pictures, "translation": translated, "cycle": back(translated)}
    if photographs is not None:
        nearest = _nearest(translated, photographs)
        columns["nearest photograph"] = photographs.images[nearest]
        files = tuple(photographs.files[k] for k in nearest)
    strips = [_column(name, shown) for name, shown in columns.items()]
    with atomically(path) as temporary:
        _, data = cv2.imencode(".png", np.hstack(strips)[..., ::-1])
        temporary.write_bytes(np.asarray(data).tobytes())
    return files


def _nearest(pictures: np.ndarray, photographs: Pictures) -> np.ndarray:
    real = features(photographs.images)
    mean, deviation = real.mean(0), real.std(0) + 1e-6
    ours, theirs = (features(pictures) - mean) / deviation, (real - mean) / deviation
    return np.array([np.square(theirs - row).sum(1).argmin() for row in ours])


def _closeness(made: np.ndarray, real: np.ndarray) -> Closeness:
    return Closeness(kernel_distance(made, real), frechet_distance(made, real))


def _column(name: str, pictures: np.ndarray) -> np.ndarray:
    width = pictures.shape[2] * _ENLARGED + _GAP
    title = np.full((16, width, 3), 255, np.uint8)
    cv2.putText(title, name, (2, 12), cv2.FONT_HERSHEY_SIMPLEX, 0.4, (0, 0, 0), 1, cv2.LINE_AA)
    rows = [title]
    for picture in pictures:
        large = cv2.resize(
            picture, None, fx=_ENLARGED, fy=_ENLARGED, interpolation=cv2.INTER_NEAREST
        )
        rows.append(
            cv2.copyMakeBorder(large, 0, _GAP, 0, _GAP, cv2.BORDER_CONSTANT, value=(255, 255, 255))
        )
    return np.vstack(rows)


def even_rows(pictures: Pictures, count: int) -> np.ndarray:
    """So many pictures, spread over all (count, H, W, 3)."""
    return pictures.images[np.linspace(0, len(pictures.images) - 1, count).astype(int)]
