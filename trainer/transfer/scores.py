"""How well a parser tells classes apart."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from trainer.transfer.classes import VOID, LabelSet


@dataclass(frozen=True)
class ClassScore:
    """One class on some frames; NaN where the frames hold none of it."""

    name: str
    pixels: float  # share of the labelled pixels
    accuracy: float  # share of its pixels that were found
    iou: float  # intersection over union with the guesses


@dataclass(frozen=True)
class ParsingScore:
    """A parser on labelled frames."""

    source: str  # of the frames
    frames: int
    pixel_accuracy: float
    class_accuracy: float  # mean over the classes that occur
    mean_iou: float  # likewise
    classes: tuple[ClassScore, ...]


def score_classes(
    truth: np.ndarray, guess: np.ndarray, labels: LabelSet, source: str = ""
) -> ParsingScore:
    """The scores of guesses (N, H, W) uint8; pixels whose truth is void do not count."""
    classes, counted = len(labels.classes), truth != VOID
    pairs = truth[counted].astype(np.int64) * classes + guess[counted]
    matrix = np.bincount(pairs, minlength=classes**2).reshape(classes, classes).astype(float)
    hit, there, guessed = np.diag(matrix), matrix.sum(1), matrix.sum(0)
    with np.errstate(divide="ignore", invalid="ignore"):
        accuracy = np.where(there > 0, hit / there, np.nan)
        iou = np.where(there > 0, hit / (there + guessed - hit), np.nan)
    rows = zip(labels.classes, there / matrix.sum(), accuracy, iou, strict=True)
    return ParsingScore(
        source,
        len(truth),
        float(hit.sum() / matrix.sum()),
        float(np.nanmean(accuracy)),
        float(np.nanmean(iou)),
        tuple(ClassScore(name, float(p), float(a), float(i)) for name, p, a, i in rows),
    )
