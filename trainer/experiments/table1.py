"""Table 1 of paper B: who foretells what a person did on a recorded drive."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from rich.console import Console
from rich.table import Table as RichTable

from robot.contract import ImageSpec
from robot.errors import ConfigError
from trainer.experiments.drive_pictures import (
    See,
    Stacks,
    Turning,
    goes_on_turning,
    load_stacks,
    shifts_px,
    split_by_time,
    turning,
)
from trainer.experiments.racing_policy import SteeringPolicy
from trainer.experiments.records import Drive, Turn, load_drive
from trainer.experiments.supervised import teach_turns
from trainer.presets import preset
from trainer.run import atomically

# Paper B, Table 1, on Sully Chen's frames.
PAPER = {"ours": 0.4340, "b-rl": 0.2833, "supervised": 0.5360}
RESAMPLES = 2000
BLOCK_FRAMES = 20  # neighbours are alike: whole stretches are drawn together
DECISION_S = 0.1  # between a policy's pictures
Named = tuple[str, int, SteeringPolicy]


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


def foretell(
    data: Path,
    out: Path,
    policies: Sequence[Named],
    rate_hz: float,
    seeds: int,
    steps: int,
    console: Console,
) -> Table:
    """Everyone's accuracy on the test part of a drive.

    Args:
        data: the drive, see `trainer.experiments.records`.
        out: a folder that exists, for the supervised networks.
        policies: names, seeds and policies.
        rate_hz: pictures of the drive in a second.
        seeds: how many supervised networks of each kind.
        steps: updates of each.
        console: hears of progress.

    Raises:
        ConfigError: the drive cannot be read, or is none to learn or to test on.
    """
    drive = load_drive(data)
    if drive.skipped:
        console.print(f"{data}: skipped {drive.skipped} broken records", markup=False)
    every = pictures_apart(rate_hz)
    image = preset("track", "ppo", "fast").image
    training, test = split_by_time(load_stacks(drive, image, every))
    for part, name in ((training, "first 60 %"), (test, "rest")):
        _refuse_one_turn(part, name, drive)
    moved_px = shifts_px(drive)
    of_angles = turning(drive.steering_deg, moved_px)
    rows = chance(test.turns, int(np.bincount(training.turns).argmax()))
    rows += _going_on(drive, moved_px, training, test)
    for name, seed, policy in policies:
        seen = split_by_time(load_stacks(drive, policy.image, every, policy.see))[1].stacked()
        rows.append(compare(name, seed, test.turns, policy.turns(seen)))
    for kind, (pictures, how) in _supervised(policies, image).items():
        part, rest = split_by_time(load_stacks(drive, pictures, every, how))
        for seed in range(seeds):
            checkpoint = out / f"{_stem(kind)}_{seed}_{steps}.pt"
            network = teach_turns(part, steps, seed, checkpoint, console)
            rows.append(compare(kind, seed, rest.turns, network.turns(rest.stacked())))
    counts = len(training.last), len(test.last)
    parts = shares(training.turns), shares(test.turns)
    return Table(str(data), *counts, *parts, of_angles, tuple(rows))


def _supervised(
    policies: Sequence[Named], image: ImageSpec
) -> dict[str, tuple[ImageSpec, See | None]]:
    """What supervised networks see: the task's pictures; and for each translator that a policy sees
    the drive through, pictures of that size, and what it makes of them."""
    kinds: dict[str, tuple[ImageSpec, See | None]] = {"supervised": (image, None)}
    through: dict[str, str] = {}  # the first policy of each translator
    for name, _, policy in policies:
        if policy.translator and through.setdefault(policy.translator, name) == name:
            kinds.setdefault(f"supervised, size of {name}", (policy.image, None))
            kinds.setdefault(f"supervised, as {name} sees", (policy.image, policy.see))
    return kinds


def pictures_apart(rate_hz: float) -> int:
    """Of how many pictures one is taken, so that a stack's are a decision apart.

    Raises:
        ConfigError: no such rate.
    """
    if not rate_hz > 0.0:
        raise ConfigError(f"rate: expected pictures in a second, above 0, got {rate_hz}")
    return max(1, round(DECISION_S * rate_hz))


def _stem(look: str) -> str:
    return re.sub(r"[^A-Za-z0-9]+", "_", look)


def _refuse_one_turn(part: Stacks, name: str, drive: Drive) -> None:
    done = {Turn(turn).name.lower() for turn in part.turns.tolist()}
    if len(done) < 2:
        low, high = drive.steering_deg.min(), drive.steering_deg.max()
        raise ConfigError(
            f"drive: expected turns of two kinds at least in its {name}, got only "
            f"{', '.join(done)}; the angles go from {low:.3g} to {high:.3g} degrees: another part "
            "of the drive, or other units?"
        )


def _going_on(drive: Drive, moved_px: np.ndarray, training: Stacks, test: Stacks) -> list[Accuracy]:
    """Who goes on turning as the pictures turn, the scale of it from the training part."""
    end = int(training.last[-1])
    scale = turning(drive.steering_deg[: end + 1], moved_px[:end])
    if scale.px_per_deg <= 0.0:
        return []
    guessed = goes_on_turning(moved_px, scale.px_per_deg, test.reach)[test.last]
    return [compare("goes on turning", 0, test.turns, guessed)]


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


def as_table(table: Table) -> RichTable:
    """For the terminal."""
    left, straight, right = table.shares
    title = (
        f"{table.test_frames} test frames: {left:.0%} left, {straight:.0%} straight, "
        f"{right:.0%} right"
    )
    columns = ("driver", "seed", "accuracy", "95 % interval", "mean of recalls", "paper B")
    shown = RichTable(*columns, title=title)
    for row in table.rows:
        paper = f"{PAPER[row.driver]:.1%}" if row.driver in PAPER else ""
        figures = f"{row.accuracy:.1%}", f"{row.low:.1%} to {row.high:.1%}", f"{row.balanced:.1%}"
        shown.add_row(row.driver, str(row.seed), *figures, paper)
    return shown
