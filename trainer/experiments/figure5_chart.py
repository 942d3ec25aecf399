"""Figure 5 of paper B as a picture and as a table, the paper's claims beside what was found."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from rich.table import Table as RichTable

from trainer.experiments.figure5 import VARIANTS, Figure5Options, run_folder
from trainer.run import atomically
from trainer.training.checkpoint import Evaluated, read_state

_COLOURS = {"oracle": "black", "translated": "darkred", "dr": "steelblue", "none": "darkorange"}
_GRID = 200  # steps at which seeds are averaged
LAST_SHARE = 0.25  # of the steps: what a driver earns there is what it has learned
# Student's t, 97.5 %, by degrees of freedom (Fisher and Yates 1938, table III)
_T = (float("nan"), 12.706, 4.303, 3.182, 2.776, 2.571, 2.447, 2.365, 2.306, 2.262)


@dataclass(frozen=True)
class Curve:
    """One kind of driver: greedy reward on the test track against steps, over its seeds."""

    variant: str
    steps: tuple[tuple[int, ...], ...]  # of each seed's evaluations
    rewards: tuple[tuple[float, ...], ...]  # an episode's, mean
    learned: tuple[float, ...]  # of each seed, the mean over the last quarter of the steps
    success: tuple[float, ...]  # likewise, share of laps driven to the end

    @property
    def mean(self) -> float:
        """Of what the seeds learned."""
        return float(np.mean(self.learned))

    @property
    def margin(self) -> float:
        """Half of Student's 95 % interval of `mean`; NaN with one seed."""
        return float(half_interval(np.array(self.learned)))


@dataclass(frozen=True)
class Figure5:
    """``figure5.json``."""

    options: Figure5Options
    curves: tuple[Curve, ...]  # in the order of `VARIANTS`
    schema: int = 1

    @property
    def claims(self) -> dict[str, bool]:
        """Which neighbours in the paper's order are in this order here, by their means."""
        pairs = zip(self.curves, self.curves[1:], strict=False)
        return {f"{a.variant} over {b.variant}": a.mean >= b.mean for a, b in pairs}


def half_interval(values: np.ndarray) -> np.ndarray:
    """Half of Student's 95 % interval of the mean over the first axis; up to ten values."""
    count = len(values)
    if count < 2:
        return np.full(values.shape[1:], np.nan)
    return np.asarray(_T[count - 1] * values.std(axis=0, ddof=1) / np.sqrt(count))


def gather(out: Path, options: Figure5Options) -> Figure5:
    """What all trainings have recorded."""
    curves = []
    for name in VARIANTS:
        seeds = range(options.seeds)
        runs = [read_state(run_folder(out, name, s).checkpoint).evaluations for s in seeds]
        last = [_last(run) for run in runs]
        curves.append(
            Curve(
                name,
                tuple(tuple(e.step for e in run) for run in runs),
                tuple(tuple(e.mean_reward for e in run) for run in runs),
                tuple(float(np.mean([e.mean_reward for e in run])) for run in last),
                tuple(float(np.mean([e.success_rate for e in run])) for run in last),
            )
        )
    return Figure5(options, tuple(curves))


def _last(evaluations: Sequence[Evaluated]) -> list[Evaluated]:
    begin = (1.0 - LAST_SHARE) * evaluations[-1].step
    return [e for e in evaluations if e.step >= begin]


def as_table(found: Figure5) -> RichTable:
    """A row for each kind of driver."""
    options = found.options
    title = f"{options.algo} on {options.test_map} in {options.test_look}, {options.steps:,} steps"
    columns = ("driver", "reward of a lap", "each seed", "laps driven", "paper's order", "holds")
    table = RichTable(*columns, title=title)
    above = [None, *found.curves]
    for place, (curve, better) in enumerate(zip(found.curves, above, strict=False), start=1):
        holds = "" if better is None else str(better.mean >= curve.mean)
        table.add_row(
            VARIANTS[curve.variant].title,
            f"{curve.mean:.1f} ± {curve.margin:.1f}",
            ", ".join(f"{reward:.1f}" for reward in curve.learned),
            f"{np.mean(curve.success):.0%}",
            str(place),
            holds,
        )
    return table


def on_common_steps(curve: Curve) -> tuple[np.ndarray, np.ndarray]:
    """Steps (K,) and rewards (seeds, K), where all seeds have been judged."""
    first = max(steps[0] for steps in curve.steps)
    last = min(steps[-1] for steps in curve.steps)
    grid = np.linspace(first, max(first, last), _GRID)
    pairs = zip(curve.steps, curve.rewards, strict=True)
    return grid, np.array([np.interp(grid, steps, rewards) for steps, rewards in pairs])


def draw_figure(found: Figure5, path: Path) -> None:
    """Write the picture: seeds as thin lines, their means with Student's 95 % intervals."""
    figure = Figure(figsize=(7.2, 4.2), layout="constrained")
    axis = figure.subplots()
    for curve in found.curves:
        grid, rewards = on_common_steps(curve)
        mean, half = rewards.mean(axis=0), half_interval(rewards)
        colour, label = _COLOURS[curve.variant], VARIANTS[curve.variant].title
        axis.plot(grid, mean, color=colour, label=label)
        if len(rewards) > 1:
            axis.plot(grid, rewards.T, color=colour, linewidth=0.6)
            axis.fill_between(grid, mean - half, mean + half, color=colour, alpha=0.15, linewidth=0)
    options = found.options
    seen = [reward for curve in found.curves for seed in curve.rewards for reward in seed]
    room = 0.1 * (max(seen) - min(seen)) + 0.1  # intervals of few seeds would fill any picture
    axis.set(
        ylim=(min(seen) - room, max(seen) + room),
        xlabel="steps of training",
        ylabel="reward of a lap, greedy",
        title=f"judged on {options.test_map} in {options.test_look} ({len(rewards)} seeds, 95 %)",
    )
    axis.legend(frameon=False)
    axis.grid(alpha=0.25)
    with atomically(path) as temporary:
        figure.savefig(temporary, format="png", dpi=110)
