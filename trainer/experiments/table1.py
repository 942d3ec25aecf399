"""Table 1 of paper B: how often a driver foretells what a person did on real frames."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from trainer.experiments.records import Turn
from trainer.experiments.turning import Turning
from trainer.run import atomically

# Paper B, Table 1, on Sully Chen's frames.
PAPER = {"ours": 0.4340, "b-rl": 0.2833, "supervised": 0.5360}
RESAMPLES = 2000
BLOCK_FRAMES = 20  # neighbours are alike: whole stretches are drawn together


@dataclass(frozen=True)
class Accuracy:
    """One driver on the test frames."""

    driver: str
    seed: int
    accuracy: float
    low: float  # 95 % interval, see `interval`
    high: float
    balanced: float  # mean of the three recalls
    recalls: tuple[float, float, float]  # left, straight, right; NaN where there is none
    guessed: tuple[float, float, float]  # share of the frames


@dataclass(frozen=True)
class Table:
    """``table1.json``."""

    data: str
    training_frames: int
    test_frames: int
    training_shares: tuple[float, float, float]  # of left, straight and right
    shares: tuple[float, float, float]  # likewise, of the test frames
    turning: Turning  # how the angles go with what the pictures show
    rows: tuple[Accuracy, ...]


def compare(driver: str, seed: int, wanted: np.ndarray, guessed: np.ndarray) -> Accuracy:
    """How far guesses (N,) agree with what the person did (N,), values of `Turn`."""
    right = wanted == guessed
    low, high = interval(right, np.random.default_rng(0))
    recalls = [right[wanted == turn].mean() if (wanted == turn).any() else np.nan for turn in Turn]
    return Accuracy(
        driver,
        seed,
        float(right.mean()),
        low,
        high,
        float(np.nanmean(recalls)),
        (float(recalls[0]), float(recalls[1]), float(recalls[2])),
        shares(guessed),
    )


def shares(turns: np.ndarray) -> tuple[float, float, float]:
    """Of left, straight and right among (N,) turns."""
    left, straight, right = (float(np.mean(turns == turn)) for turn in Turn)
    return left, straight, right


def interval(right: np.ndarray, rng: np.random.Generator) -> tuple[float, float]:
    """95 % interval of the mean of (N,) booleans in order of time: circular block bootstrap.

    Politis and Romano 1992. It holds for this drive; another day on another track is another draw.
    """
    count = len(right)
    block = min(BLOCK_FRAMES, count)
    starts = rng.integers(count, size=(RESAMPLES, -(-count // block)))
    drawn = (starts[..., None] + np.arange(block)) % count
    means = right[drawn.reshape(RESAMPLES, -1)[:, :count]].mean(1)
    low, high = np.quantile(means, (0.025, 0.975))
    return float(low), float(high)


def chance(wanted: np.ndarray, common: int) -> list[Accuracy]:
    """Who needs no picture: drawing among three, always the training's commonest turn, the test's.

    Args:
        wanted: (N,) values of `Turn` of the test.
        common: the commonest of the training.
    """
    drawn = np.random.default_rng(0).integers(len(Turn), size=len(wanted))
    often = int(np.bincount(wanted, minlength=len(Turn)).argmax())
    always = [
        compare(f"always {Turn(turn).name.lower()}", 0, wanted, np.full(len(wanted), turn))
        for turn in dict.fromkeys((common, often))
    ]
    return [compare("drawn by lot", 0, wanted, drawn), *always]


def draw_table(table: Table, path: Path) -> None:
    """Bars of each driver's accuracy with every seed's interval, the paper's figures beside."""
    drivers = list(dict.fromkeys(row.driver for row in table.rows))
    figure = Figure(figsize=(8.0, 1.2 + 0.42 * len(drivers)), layout="constrained")
    axis = figure.subplots()
    for y, driver in enumerate(drivers):
        rows = [row for row in table.rows if row.driver == driver]
        axis.barh(y - 0.17, mean(rows), 0.32, color="steelblue", label="here" if y == 0 else None)
        for k, row in enumerate(rows):
            place = y - 0.17 + 0.08 * (k - (len(rows) - 1) / 2)
            axis.plot([row.low, row.high], [place, place], color="black", linewidth=1)
            axis.plot(row.accuracy, place, "o", color="black", markersize=3)
        if driver in PAPER:
            axis.barh(y + 0.17, PAPER[driver], 0.32, color="lightgrey")
    axis.barh(0, 0.0, 0.0, color="lightgrey", label="paper B, other data")
    axis.set_yticks(range(len(drivers)), drivers)
    axis.invert_yaxis()
    axis.set(xlim=(0, 1), xlabel="turns foretold", title=f"{table.test_frames} test frames")
    axis.legend(frameon=False, fontsize="small")
    axis.grid(axis="x", alpha=0.25)
    with atomically(path) as temporary:
        figure.savefig(temporary, format="png", dpi=110)


def mean(rows: Sequence[Accuracy]) -> float:
    """The mean accuracy of one driver's seeds."""
    return float(np.mean([row.accuracy for row in rows]))
