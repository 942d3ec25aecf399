"""Figure 5 of paper B: the way through scene parsing beside domain randomisation, on race tracks.

All drivers learn by the same algorithm and are judged, while they learn, on the same track in the
same look. One learns right there (the paper's "Oracle"), the others on another track in other
looks: seen through a translator into the look of the test, in ten looks, or as it is.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
from matplotlib.figure import Figure
from rich.console import Console
from rich.table import Table as RichTable

from trainer.experiments.options import Figure5Options
from trainer.experiments.tables import half_interval
from trainer.options import TrainOptions
from trainer.run import RunFolder, atomically
from trainer.sweeps.jobs import TrainJob
from trainer.training.checkpoint import Evaluated, read_state

_COLOURS = {"oracle": "black", "translated": "darkred", "dr": "steelblue", "none": "darkorange"}
_GRID = 200  # steps at which seeds are averaged
LAST_SHARE = 0.25  # of the steps: what a driver earns there is what it has learned


class Variant(NamedTuple):
    """A kind of driver."""

    title: str
    at_the_test: bool  # learns where it is judged
    randomised: bool = False
    translated: bool = False


VARIANTS = {  # in the paper's order, the best first
    "oracle": Variant("Oracle", at_the_test=True),
    "translated": Variant("translated through parsing", at_the_test=False, translated=True),
    "dr": Variant("domain randomisation", at_the_test=False, randomised=True),
    "none": Variant("untranslated", at_the_test=False),
}


def translator(out: Path, options: Figure5Options, console: Console) -> Path:
    """The ONNX translator from the training's look into the test's; made where it is missing.

    Raises:
        DuckpilotError: a track or look that does not exist.
    """
    from trainer.run import take_up
    from trainer.transfer.collect import Source, collect_simulator
    from trainer.transfer.options import ThroughOptions
    from trainer.transfer.through_parsing import translate_through

    path = out / "translator"
    halves = {
        "frames": (options.map, options.look),
        "test_frames": (options.test_map, options.test_look),
    }
    for name, (place, look) in halves.items():
        if not (out / name).exists():
            console.print(f"{out / name}: {options.frames} frames of {place} in {look}")
            source = Source("simulator", (place,), options.frames, look)
            out.mkdir(parents=True, exist_ok=True)
            collect_simulator(out / name, source, lambda _: None)
    if (path / "sim_to_real.onnx").exists():
        return path / "sim_to_real.onnx"
    wanted = ThroughOptions(
        sim=str(out / "frames"),
        real=str(out / "test_frames"),
        preset=options.preset,
        steps=options.translator_steps,
        task="track",
        labels="track",
    )
    run = take_up(ThroughOptions, path, resume=True, fresh=lambda: wanted)
    return translate_through(path, run, console)


def run_folder(out: Path, variant: str, seed: int) -> RunFolder:
    """Of one training."""
    return RunFolder(out / f"{variant}_{seed}")


def trainings(out: Path, options: Figure5Options, translator: Path) -> list[TrainJob]:
    """All of them, seed by seed, so that every kind has come equally far."""
    return [
        TrainJob(
            run_folder(out, name, seed).path,
            _training(options, variant, seed, translator),
            resume=True,
        )
        for seed in range(options.seeds)
        for name, variant in VARIANTS.items()
    ]


def _training(
    options: Figure5Options, variant: Variant, seed: int, translator: Path
) -> TrainOptions:
    look = options.looks if variant.randomised else options.look
    return TrainOptions(
        task="track",
        algo=options.algo,
        preset=options.preset,
        map=(options.test_map if variant.at_the_test else options.map,),
        steps=options.steps,
        seed=seed,
        look=options.test_look if variant.at_the_test else look,
        translate=str(translator) if variant.translated else None,
        judge_map=(options.test_map,),
        judge_look=options.test_look,
        full=True,
    )


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
