"""Learning curves: the reward of each episode and its 50-episode mean against steps (paper A)."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from trainer.checkpoint import Evaluated, read_state
from trainer.config import RunConfig
from trainer.run import Episode, RunFolder, atomically

MEAN_EPISODES = 50  # paper A, Figures 30 to 39


def running_mean(values: np.ndarray, window: int = MEAN_EPISODES) -> np.ndarray:
    """Mean of the last ``window`` values, of fewer at the beginning; (N,) -> (N,)."""
    total = np.cumsum(np.insert(values, 0, 0.0))
    upper = np.arange(1, len(values) + 1)
    lower = np.maximum(upper - window, 0)
    return (total[upper] - total[lower]) / (upper - lower)


def draw_curve(folder: RunFolder, config: RunConfig) -> None:
    """Write ``curve.png`` of one run."""
    draw_curves([(folder, config)], folder.curve)


def draw_curves(runs: Sequence[tuple[RunFolder, RunConfig]], path: Path) -> None:
    """Write one picture with a panel per run, two in a row."""
    columns = min(2, len(runs))
    rows = -(-len(runs) // columns)
    figure = Figure(figsize=(6.4 * columns, 3.6 * rows), layout="constrained")
    axes = np.asarray(figure.subplots(rows, columns, squeeze=False)).ravel()
    for axis, (folder, config) in zip(axes, runs, strict=False):
        title = f"{config.task}, {config.algorithm} ({config.preset}, seed {config.seed})"
        _draw(axis, folder.episodes(), title)
        if folder.checkpoint.exists():
            _draw_evaluations(axis, read_state(folder.checkpoint).evaluations)
        axis.legend(loc="lower right", frameon=False, fontsize="small")
    for axis in axes[len(runs) :]:
        axis.set_visible(False)
    with atomically(path) as temporary:
        figure.savefig(temporary, format="png", dpi=110)


def _draw(axis: Axes, episodes: Sequence[Episode], title: str) -> None:
    steps = np.array([e.step for e in episodes])
    rewards = np.array([e.reward for e in episodes])
    axis.plot(steps, rewards, color="pink", linewidth=0.7, label="episode")
    axis.plot(
        steps,
        running_mean(rewards),
        color="darkred",
        linewidth=1.6,
        label=f"mean of {MEAN_EPISODES}",
    )
    axis.set(title=title, xlabel="steps", ylabel="reward of an episode")
    axis.grid(alpha=0.25)


def _draw_evaluations(axis: Axes, evaluations: Sequence[Evaluated]) -> None:
    """What the policy of the moment earns without random actions; filled where none failed."""
    for perfect, face, label in ((False, "white", "greedy"), (True, "black", "greedy, no failure")):
        shown = [e for e in evaluations if (e.success_rate == 1.0) == perfect]
        if shown:
            x, y = [e.step for e in shown], [e.mean_reward for e in shown]
            axis.plot(x, y, "o", color="black", markerfacecolor=face, markersize=4.5, label=label)
