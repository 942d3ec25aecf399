"""Learning curves: the reward of each episode and its 50-episode mean against steps (paper A)."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from textwrap import fill

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from trainer.algorithms import find_algorithm
from trainer.config import RunConfig
from trainer.run import Episode, RunFolder, atomically
from trainer.training.checkpoint import Evaluated, read_state

MEAN_EPISODES = 50  # paper A, Figures 30 to 39
_TITLE_LETTERS = 56  # in a line above a panel
_MEAN = f"mean of {MEAN_EPISODES}"
PINK, DARK_RED = "pink", "darkred"
GRID_POINTS = 400  # steps at which runs of several seeds are averaged

Record = tuple[Sequence[Episode], Sequence[Evaluated]]  # of one run


def running_mean(values: np.ndarray, window: int = MEAN_EPISODES) -> np.ndarray:
    """Mean of the last ``window`` values, of fewer at the beginning; (N,) -> (N,)."""
    total = np.cumsum(np.insert(values, 0, 0.0))
    upper = np.arange(1, len(values) + 1)
    lower = np.maximum(upper - window, 0)
    return (total[upper] - total[lower]) / (upper - lower)


def draw_curve(folder: RunFolder, config: RunConfig) -> None:
    """Write ``curve.png`` of one run."""
    evaluations = read_state(folder.checkpoint).evaluations if folder.checkpoint.exists() else []
    name = find_algorithm(config.algorithm).title
    title = f"{config.task}, {name} ({config.preset}, seed {config.seed})"
    draw_panels([(title, [(folder.episodes(), evaluations)])], folder.curve)


def draw_panels(panels: Sequence[tuple[str, Sequence[Record]]], path: Path) -> None:
    """Write one picture with a titled panel per set of runs, two in a row."""
    columns = min(2, len(panels))
    rows = -(-len(panels) // columns)
    figure = Figure(figsize=(6.4 * columns, 3.6 * rows), layout="constrained")
    axes = np.asarray(figure.subplots(rows, columns, squeeze=False)).ravel()
    for axis, (title, records) in zip(axes, panels, strict=False):
        axis.set(title=fill(title, _TITLE_LETTERS), xlabel="steps", ylabel="reward of an episode")
        if any(episodes for episodes, _ in records):
            _draw(axis, records)
        else:
            axis.set(xticks=[], yticks=[])
            said = "no episode yet" if records else "no run"
            axis.text(0.5, 0.5, said, ha="center", va="center", transform=axis.transAxes)
    for axis in axes[len(panels) :]:
        axis.set_visible(False)
    with atomically(path) as temporary:
        figure.savefig(temporary, format="png", dpi=110)


def mean_over_runs(runs: Sequence[Sequence[Episode]]) -> tuple[np.ndarray, np.ndarray]:
    """Running means of several runs at common steps: steps (K,) and means (runs, K).

    Only from where all of them have ended an episode to where the first of them ends.
    """
    steps = [np.array([e.step for e in run], dtype=float) for run in runs]
    means = [running_mean(np.array([e.reward for e in run])) for run in runs]
    first, last = max(s[0] for s in steps), min(s[-1] for s in steps)
    grid = np.linspace(first, max(first, last), GRID_POINTS)
    return grid, np.array([np.interp(grid, s, m) for s, m in zip(steps, means, strict=True)])


def _draw(axis: Axes, records: Sequence[Record]) -> None:
    runs = [episodes for episodes, _ in records if episodes]
    several = len(runs) > 1
    for k, episodes in enumerate(runs):
        steps, rewards = [e.step for e in episodes], np.array([e.reward for e in episodes])
        axis.plot(steps, rewards, color=PINK, linewidth=0.7, label=None if k else "episode")
        width, opacity, label = (0.6, 0.4, None) if several else (1.6, 1.0, _MEAN)
        mean = running_mean(rewards)
        axis.plot(steps, mean, color=DARK_RED, linewidth=width, alpha=opacity, label=label)
    if several:
        grid, means = mean_over_runs(runs)
        band = (means.min(axis=0), means.max(axis=0))
        axis.fill_between(grid, *band, color=DARK_RED, alpha=0.15, linewidth=0)
        label = f"{_MEAN}, of {len(runs)} seeds"
        axis.plot(grid, means.mean(axis=0), color=DARK_RED, linewidth=1.8, label=label)
    _draw_evaluations(axis, [e for _, evaluations in records for e in evaluations])
    axis.grid(alpha=0.25)
    axis.legend(loc="upper left", framealpha=0.8, fontsize="small")


def _draw_evaluations(axis: Axes, evaluations: Sequence[Evaluated]) -> None:
    """What the policy of the moment earns without random actions; filled where none failed."""
    for perfect, face, label in ((False, "white", "greedy"), (True, "black", "greedy, no failure")):
        shown = [e for e in evaluations if (e.success_rate == 1.0) == perfect]
        if shown:
            x, y = [e.step for e in shown], [e.mean_reward for e in shown]
            axis.plot(x, y, "o", color="black", markerfacecolor=face, markersize=4, label=label)
