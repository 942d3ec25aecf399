"""Paper A's comparison of ways from simulation to reality: Tables 4 and 5, Figures 36 to 39.

Every algorithm is trained in the nominal look, under domain randomisation, through a CycleGAN, and
through both, with the same number of steps, maps and pose error. All are judged in looks that no
training saw: four laps of lane keeping, each of a map's manoeuvres once, and random missions.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from statistics import mean, median
from typing import NamedTuple

import numpy as np

from robot.output import write_json, write_text
from robot.typed_config import read_json, to_plain
from trainer.algorithms import find_algorithm
from trainer.experiments.cli import SixModelsOptions
from trainer.options import EvaluateOptions, TrainOptions
from trainer.report.curves import draw_panels, half_interval
from trainer.run import RunFolder
from trainer.sweeps.jobs import EvaluateJob, TrainJob
from trainer.training.checkpoint import read_state

ALGORITHMS = ("dueling", "ppo")
PATHS, MISSIONS = 32, 50  # of each navigator
FIRST_SEED = 160 * 32  # whole worlds of 160 episodes: 32 paths are then each path once
# Of 32 paths and of 50 missions; the models that are not named failed (fewer than 10 paths).
PAPER = {("dueling", "cyclegan"): (27, 31), ("ppo", "cyclegan"): (24, 26)}
SUCCESS_ABOVE, FAILURE_BELOW = 20, 10  # paths

VARIANTS = {  # how simulation is made to resemble reality: title, look, translated
    "none": ("nothing", "nominal", False),
    "dr": ("domain randomisation", "randomised", False),
    "cyclegan": ("CycleGAN", "nominal", True),
    "dr_cyclegan": ("both", "randomised", True),
}


class Model(NamedTuple):
    """One of the models that are compared: a navigator, and a lane keeper trained alike."""

    algorithm: str
    variant: str
    seed: int

    def run(self, out: Path, task: str) -> Path:
        """The run folder of one of its trainings: lane or navigation."""
        return out / f"{task}_{self.algorithm}_{self.variant}_{self.seed}"

    def judged(self, out: Path, test: str) -> Path:
        """The figures of one of its tests: laps, paths or tasks."""
        return self.run(out, "lane" if test == "laps" else "navigation") / f"{test}.json"


def kinds(options: SixModelsOptions) -> list[list[Model]]:
    """Models that differ by their seeds only, together; in the order of the paper's tables."""
    return [
        [Model(algorithm, name, seed) for seed in range(options.seeds)]
        for name, (_, _, translated) in VARIANTS.items()
        if options.translator is not None or not translated
        for algorithm in ALGORITHMS
    ]


def trainings(out: Path, options: SixModelsOptions, among: Sequence[Model]) -> list[TrainJob]:
    """Two for each of these models."""
    jobs = []
    for model in among:
        _, look, translated = VARIANTS[model.variant]
        usual = TrainOptions(
            algo=model.algorithm,
            preset=options.preset,
            seed=model.seed,
            look=look,
            translate=options.translator if translated else None,
            judgings=options.judgings,
            full=True,
        )
        steps = options.ppo_steps if model.algorithm == "ppo" else options.steps
        guided = replace(usual, map=options.map, steps=steps, pose_error=options.pose_error)
        lane = replace(usual, steps=options.lane_steps)
        for task, job in (("navigation", guided), ("lane", lane)):
            jobs.append(TrainJob(model.run(out, task), replace(job, task=task), resume=True))
    return jobs


def trials(options: SixModelsOptions) -> dict[str, EvaluateOptions]:
    """The three tests. The policy sees what is there, untranslated."""
    usual = EvaluateOptions(look=options.look, seed=FIRST_SEED)
    arena = replace(usual, map=(options.test_map,), pose_error=options.pose_error)
    return {
        "laps": replace(usual, task="four_laps", episodes=options.lap_drives),
        "paths": replace(arena, task="manoeuvres", episodes=PATHS),
        "tasks": replace(arena, task="navigation", episodes=MISSIONS),
    }


def drives(out: Path, options: SixModelsOptions, among: Sequence[Model]) -> list[EvaluateJob]:
    """The tests of each of these models."""
    jobs = []
    for model in among:
        for name, trial in trials(options).items():
            file = model.judged(out, name)
            asked = replace(trial, model=str(RunFolder(file.parent).onnx))
            jobs.append(EvaluateJob(file, asked, drives=True))
    return jobs


@dataclass(frozen=True)
class TransferRow:
    """Models that differ by their seeds only, in the order of the seeds."""

    algorithm: str
    variant: str
    laps: tuple[int, ...]  # drives of four laps without leaving the lane
    paths: tuple[int, ...]
    tasks: tuple[int, ...]

    @property
    def verdict(self) -> str:
        """The paper's, on the median model: more than 20 of 32 paths, or fewer than 10."""
        paths = median(self.paths)
        if paths > SUCCESS_ABOVE:
            return "success"
        return "failure" if paths < FAILURE_BELOW else "neither"


def gather(out: Path, options: SixModelsOptions) -> list[TransferRow]:
    """The figures of all tests; they must have been run."""

    def successes(model: Model, test: str) -> int:
        found = read_json(model.judged(out, test))
        return int(found["episodes"]) - len(found["failures"])

    return [
        TransferRow(
            *kind[0][:2],
            *(tuple(successes(model, test) for model in kind) for test in trials(options)),
        )
        for kind in kinds(options)
    ]


def report(out: Path, options: SixModelsOptions) -> str:
    """Write six_models.json, .md and .png; the table."""
    found, panels = gather(out, options), []
    episodes = {name: trial.episodes for name, trial in trials(options).items()}
    told = {"options": to_plain(options), "episodes": episodes, "rows": to_plain(found)}
    write_json(out / "six_models.json", {**told, "schema": 1})
    for kind in kinds(options):
        runs = [RunFolder(model.run(out, "navigation")) for model in kind]
        records = [(run.episodes(), read_state(run.checkpoint).evaluations) for run in runs]
        title, way = find_algorithm(kind[0].algorithm).title, VARIANTS[kind[0].variant][0]
        panels.append((f"{title}, transfer by {way}", records))
    draw_panels(panels, out / "six_models.png")
    head, *rows = table_rows(found, episodes)
    text = "".join(f"| {' | '.join(cells)} |\n" for cells in (head, ["---"] * len(head), *rows))
    write_text(out / "six_models.md", text)
    return text


def table_rows(found: Sequence[TransferRow], episodes: Mapping[str, int]) -> list[tuple[str, ...]]:
    """Both of the paper's tables in one, its figures beside ours; the first row says what is what.

    Ours are each seed's, with the 95 % interval of their mean.
    """
    laps, paths, tasks = (f"of {count}" for count in episodes.values())
    asked = (f"four laps {laps}", f"paths {paths}", "verdict", "paper", f"missions {tasks}")
    rows: list[tuple[str, ...]] = [("transfer", "algorithm", *asked, "paper")]
    for row in found:
        failed = "failure" if row.variant in ("none", "dr") else "–"
        theirs = PAPER.get((row.algorithm, row.variant), (failed, "–"))
        names = VARIANTS[row.variant][0], find_algorithm(row.algorithm).title
        ours = _each(row.laps), _each(row.paths), row.verdict
        rows.append((*names, *ours, str(theirs[0]), _each(row.tasks), str(theirs[1])))
    return rows


def _each(counts: tuple[int, ...]) -> str:
    seeds = ", ".join(map(str, counts))
    if len(counts) < 2:
        return seeds
    return f"{seeds} ({mean(counts):.1f} ± {half_interval(np.array(counts)):.1f})"
