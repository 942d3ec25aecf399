"""Figure 5 of paper B: the way through scene parsing beside domain randomisation, on race tracks.

All drivers learn by the same algorithm and are judged, while they learn, on the same track in the
same look. One learns right there (the paper's "Oracle"), the others on another track in other
looks: seen through a translator into the look of the test, in ten looks, or as it is.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from rich.console import Console
from rich.table import Table as RichTable

from robot.errors import ConfigError
from robot.typed_config import load_yaml
from trainer.experiments.cli import Figure5Options
from trainer.options import TrainOptions
from trainer.report.curves import half_interval, save_figure
from trainer.run import RunFolder
from trainer.sweeps.jobs import TrainJob
from trainer.training.checkpoint import read_state

_GRID = 200  # steps at which seeds are averaged
LAST_SHARE = 0.25  # of the steps: what a driver earns there is what it has learned

VARIANTS = {  # titles and colours, in the paper's order, the best first
    "oracle": ("Oracle", "black"),
    "translated": ("translated through parsing", "darkred"),
    "dr": ("domain randomisation", "steelblue"),
    "none": ("untranslated", "darkorange"),
}


def translator(out: Path, options: Figure5Options, console: Console) -> Path:
    """The ONNX translator from the training's look into the test's; made where it is missing."""
    from trainer.run import take_up
    from trainer.transfer.cli import Source, ThroughOptions
    from trainer.transfer.pictures import collect
    from trainer.transfer.pix2pix import translate_through

    path, made = out / "translator", out / "translator" / "sim_to_real.onnx"
    frames = ("frames", options.map, options.look)
    for name, place, look in (frames, ("test_frames", options.test_map, options.test_look)):
        source = Source((place,), options.frames, look)
        if (out / name).exists():
            found = load_yaml(Source, out / name / "collection.yaml")
            _expect_same(out / name, vars(found), vars(source))
        elif not made.exists():
            console.print(f"{out / name}: {options.frames} frames of {place} in {look}")
            collect(out / name, source)
    wanted = ThroughOptions(
        sim=str(out / "frames"),
        real=str(out / "test_frames"),
        preset=options.preset,
        steps=options.translator_steps,
        task="track",
        labels="track",
    )
    run = take_up(ThroughOptions, path, resume=True, fresh=lambda: wanted)
    places = {"sim": run.sim, "real": run.real}  # the folder may be called otherwise now
    _expect_same(path, vars(run), {**vars(wanted), **places})
    return made if made.exists() else translate_through(path, run, console)


def _expect_same(folder: Path, found: dict[str, Any], wanted: dict[str, Any]) -> None:
    if other := [name for name, value in found.items() if value != wanted[name]]:
        told = f"{', '.join(other)}; ask as it was made, or choose another --out"
        raise ConfigError(f"{folder}: expected what is asked for, got another {told}")


def trainings(out: Path, options: Figure5Options, translator: Path) -> list[TrainJob]:
    """All of them, seed by seed, so that every kind has come equally far."""
    worlds = {"oracle": (options.test_map, options.test_look), "dr": (options.map, options.looks)}
    jobs = []
    for seed, name in product(range(options.seeds), VARIANTS):
        place, look = worlds.get(name, (options.map, options.look))
        training = TrainOptions(
            task="track",
            algo=options.algo,
            preset=options.preset,
            map=(place,),
            steps=options.steps,
            seed=seed,
            look=look,
            translate=str(translator) if name == "translated" else None,
            judge_map=(options.test_map,),
            judge_look=options.test_look,
            full=True,
        )
        jobs.append(TrainJob(out / f"{name}_{seed}", training, resume=True))
    return jobs


@dataclass(frozen=True)
class Curve:
    """One kind of driver: greedy reward on the test track against steps, over its seeds."""

    variant: str
    steps: tuple[tuple[int, ...], ...]  # of each seed's evaluations
    rewards: tuple[tuple[float, ...], ...]  # an episode's, mean
    learned: tuple[float, ...]  # of each seed, the mean over the last quarter of the steps
    success: tuple[float, ...]  # likewise, share of laps driven to the end


def gather(out: Path, options: Figure5Options) -> list[Curve]:
    """What all trainings have recorded, in the order of `VARIANTS`."""
    curves = []
    for name in VARIANTS:
        runs = [RunFolder(out / f"{name}_{seed}") for seed in range(options.seeds)]
        records = [read_state(run.checkpoint).evaluations for run in runs]
        ends = [[e for e in r if e.step >= (1.0 - LAST_SHARE) * r[-1].step] for r in records]
        steps = tuple(tuple(e.step for e in record) for record in records)
        rewards = tuple(tuple(e.mean_reward for e in record) for record in records)
        learned = tuple(float(np.mean([e.mean_reward for e in end])) for end in ends)
        success = tuple(float(np.mean([e.success_rate for e in end])) for end in ends)
        curves.append(Curve(name, steps, rewards, learned, success))
    return curves


def as_table(asked: Figure5Options, curves: Sequence[Curve]) -> RichTable:
    """A row for each kind of driver, in the paper's order."""
    title = f"{asked.algo} on {asked.test_map} in {asked.test_look}, {asked.steps:,} steps"
    table = RichTable("driver", "reward of a lap", "each seed", "laps driven", title=title)
    for curve in curves:
        mean, margin = np.mean(curve.learned), float(half_interval(np.array(curve.learned)))
        each = ", ".join(f"{reward:.1f}" for reward in curve.learned)
        laps = f"{np.mean(curve.success):.0%}"
        table.add_row(VARIANTS[curve.variant][0], f"{mean:.1f} ± {margin:.1f}", each, laps)
    return table


def on_common_steps(curve: Curve) -> tuple[np.ndarray, np.ndarray]:
    """Steps (K,) and rewards (seeds, K), where all seeds have been judged."""
    first = max(steps[0] for steps in curve.steps)
    grid = np.linspace(first, max(first, min(steps[-1] for steps in curve.steps)), _GRID)
    pairs = zip(curve.steps, curve.rewards, strict=True)
    return grid, np.array([np.interp(grid, steps, rewards) for steps, rewards in pairs])


def draw_figure(options: Figure5Options, curves: Sequence[Curve], path: Path) -> None:
    """Write the picture: seeds as thin lines, their means with Student's 95 % intervals."""
    figure = Figure(figsize=(7.2, 4.2), layout="constrained")
    axis = figure.subplots()
    for curve in curves:
        grid, rewards = on_common_steps(curve)
        mean, half = rewards.mean(axis=0), half_interval(rewards)
        label, colour = VARIANTS[curve.variant]
        axis.plot(grid, mean, color=colour, label=label)
        if len(rewards) > 1:
            axis.plot(grid, rewards.T, color=colour, linewidth=0.6)
            axis.fill_between(grid, mean - half, mean + half, color=colour, alpha=0.15, linewidth=0)
    seen = [reward for curve in curves for seed in curve.rewards for reward in seed]
    room = 0.1 * (max(seen) - min(seen)) + 0.1  # intervals of few seeds would fill any picture
    axis.set(
        ylim=(min(seen) - room, max(seen) + room),
        xlabel="steps of training",
        ylabel="reward of a lap, greedy",
        title=f"judged on {options.test_map} in {options.test_look} ({len(rewards)} seeds, 95 %)",
    )
    axis.legend(frameon=False)
    axis.grid(alpha=0.25)
    save_figure(figure, path)
