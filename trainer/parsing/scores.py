"""How well labels agree: pixel accuracy and intersection over union, per class."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from trainer.parsing.classes import VOID, LabelSet


def confusion(truth: np.ndarray, guess: np.ndarray, classes: int) -> np.ndarray:
    """(classes, classes) int64 counts of pixels: rows are truth, columns guesses; void is left out.

    Args:
        truth: labels uint8, any shape.
        guess: labels of the same shape, without void.
        classes: how many there are.
    """
    counted = truth != VOID
    pairs = truth[counted].astype(np.int64) * classes + guess[counted]
    return np.bincount(pairs, minlength=classes * classes).reshape(classes, classes)


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


def score(matrix: np.ndarray, labels: LabelSet, frames: int, source: str = "") -> ParsingScore:
    """The scores of a confusion matrix (C, C) of so many frames."""
    matrix = matrix.astype(np.float64)
    hit, truth, guess = np.diag(matrix), matrix.sum(1), matrix.sum(0)
    occurs = truth > 0
    with np.errstate(divide="ignore", invalid="ignore"):
        accuracy = np.where(occurs, hit / truth, np.nan)
        iou = np.where(occurs, hit / (truth + guess - hit), np.nan)
    total = matrix.sum()
    rows = zip(labels.classes, truth / total, accuracy, iou, strict=True)
    return ParsingScore(
        source,
        frames,
        float(hit.sum() / total),
        float(np.nanmean(accuracy)),
        float(np.nanmean(iou)),
        tuple(ClassScore(name, float(p), float(a), float(i)) for name, p, a, i in rows),
    )
