"""Learning curves against steps: success, distance from the path, and reward as in paper A."""

from collections.abc import Callable, Sequence
from math import nan
from pathlib import Path
from statistics import median
from textwrap import fill

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import EngFormatter

from trainer.algorithms import find_algorithm
from trainer.config import RunConfig
from trainer.run import Episode, RunFolder, atomically
from trainer.training.checkpoint import Evaluated, read_state

MEAN_EPISODES = 50  # paper A, Figures 30 to 39
_TITLE_LETTERS = 56  # in a line above a panel
_MEAN = f"mean of {MEAN_EPISODES}"
PINK, DARK_RED = "pink", "darkred"
SKILLED = 0.99  # share of an evaluation's episodes; of twenty all

Record = tuple[Sequence[Episode], Sequence[Evaluated]]  # of one run


def running_mean(values: np.ndarray, window: int = MEAN_EPISODES) -> np.ndarray:
    """Mean of the last ``window`` values, of fewer at the beginning; (N,) -> (N,)."""
    total = np.cumsum(np.insert(values, 0, 0.0))
    upper = np.arange(1, len(values) + 1)
    lower = np.maximum(upper - window, 0)
    return (total[upper] - total[lower]) / (upper - lower)


def draw_curve(folder: RunFolder, config: RunConfig) -> None:
    """Write ``curve.png`` of one run."""
    evaluations = read_state(folder.checkpoint).evaluations if folder.checkpoint.exists() else ()
    name = find_algorithm(config.algorithm).title
    title = f"{config.task}, {name} ({config.preset}, seed {config.seed})"
    draw_panels([(title, [(folder.episodes(), evaluations)])], folder.curve)


def draw_panels(panels: Sequence[tuple[str, Sequence[Record]]], path: Path) -> None:
    """Write a picture with a row for each set of runs: success, distance from the path, reward."""
    evaluations = [e for _, records in panels for _, es in records for e in es]
    measured = any(e.mean_distance_m is not None for e in evaluations)
    columns = [_draw_success, *([_draw_distance] if measured else []), _draw_reward]
    figure = Figure(figsize=(4.4 * len(columns), 3.1 * len(panels)), layout="constrained")
    axes = np.asarray(figure.subplots(len(panels), len(columns), sharex="row", squeeze=False))
    for row, (title, records) in zip(axes, panels, strict=True):
        told = fill(title, _TITLE_LETTERS).replace("$", r"\$")  # else mathematics
        row[0].set_title(told, loc="left", fontsize="medium")
        for axis, draw in zip(row, columns, strict=True):
            axis.set(xlabel="steps")
            axis.xaxis.set_major_formatter(EngFormatter(sep=""))
            axis.grid(alpha=0.25)
            draw(axis, records)
            if axis.get_legend_handles_labels()[0]:
                axis.legend(framealpha=0.8, fontsize="x-small")
    save_figure(figure, path)


def save_figure(figure: Figure, path: Path) -> None:
    """As PNG, whole or not at all."""
    with atomically(path) as temporary:
        figure.savefig(temporary, format="png", dpi=110)


def half_interval(values: np.ndarray) -> np.ndarray:
    """Half of Student's 95 % interval of the mean over the first axis; NaN of one value."""
    from scipy.stats import t

    count = len(values)
    if count < 2:
        return np.full(values.shape[1:], np.nan)
    return np.asarray(t.ppf(0.975, count - 1) * values.std(axis=0, ddof=1) / np.sqrt(count))


def _draw_success(axis: Axes, records: Sequence[Record]) -> None:
    axis.set(ylabel="success [%]", ylim=(-4, 104))
    _draw_means(axis, records, lambda e: 100.0 * e.success)
    _draw_evaluations(axis, records, lambda e: 100.0 * e.success_rate)
    skilled = [[e.step for e in es if e.success_rate >= SKILLED] for _, es in records]
    learned = [min(steps) for steps in skilled if steps]
    if learned:
        label = f"learned: {median(learned):,.0f} steps"
        axis.axvline(median(learned), color="green", linestyle=":", linewidth=1.4, label=label)


def _draw_distance(axis: Axes, records: Sequence[Record]) -> None:
    _draw_evaluations(
        axis, records, lambda e: nan if e.mean_distance_m is None else 100.0 * e.mean_distance_m
    )
    axis.set(ylabel="distance from the path [cm]")
    axis.set_ylim(bottom=0.0)


def _draw_reward(axis: Axes, records: Sequence[Record]) -> None:
    axis.set(ylabel="reward of an episode")
    for k, (episodes, _) in enumerate(records):
        steps, rewards = [e.step for e in episodes], [e.reward for e in episodes]
        axis.plot(steps, rewards, color=PINK, linewidth=0.7, label=None if k else "episode")
    _draw_means(axis, records, lambda e: e.reward)
    _draw_evaluations(axis, records, lambda e: e.mean_reward)


def _draw_means(axis: Axes, records: Sequence[Record], value: Callable[[Episode], float]) -> None:
    """Of 50 episodes while learning, choices by chance among them; a line for each seed."""
    for k, (episodes, _) in enumerate(records):
        steps = [e.step for e in episodes]
        mean = running_mean(np.array([value(e) for e in episodes], dtype=float))
        axis.plot(steps, mean, color=DARK_RED, linewidth=1.4, label=None if k else _MEAN)


def _draw_evaluations(
    axis: Axes, records: Sequence[Record], value: Callable[[Evaluated], float]
) -> None:
    """The policy of the moment, without choices by chance; filled where none failed."""
    for _, evaluations in records:
        steps, values = [e.step for e in evaluations], [value(e) for e in evaluations]
        axis.plot(steps, values, color="black", linewidth=0.8, alpha=0.5)
    shown = [e for _, evaluations in records for e in evaluations]
    for perfect, face, label in ((False, "white", "evaluation"), (True, "black", "none failed")):
        some = [e for e in shown if (e.success_rate == 1.0) == perfect]
        if some:
            x, y = [e.step for e in some], [value(e) for e in some]
            axis.plot(x, y, "o", color="black", markerfacecolor=face, markersize=4, label=label)
