"""Paper A's comparison of ways from simulation to reality (section 4.4): Tables 4 and 5.

Every algorithm is trained in the nominal look, under domain randomisation, through a CycleGAN, and
through both, with the same number of steps, maps and pose error. All are judged in looks that no
training saw: four laps of lane keeping, each of a map's manoeuvres once, and random missions.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

from trainer.experiments.options import SixModelsOptions
from trainer.options import EvaluateOptions, TrainOptions
from trainer.run import RunFolder
from trainer.sweeps.jobs import EvaluateJob, TrainJob

ALGORITHMS = ("dueling", "ppo")
PATHS, MISSIONS = 32, 50  # of each navigator
FIRST_SEED = 160 * 32  # whole worlds of 160 episodes: 32 paths are then each path once


class Variant(NamedTuple):
    """How simulation is made to resemble reality in training."""

    title: str
    look: str
    translated: bool


VARIANTS = {
    "none": Variant("nothing", "nominal", translated=False),
    "dr": Variant("domain randomisation", "randomised", translated=False),
    "cyclegan": Variant("CycleGAN", "nominal", translated=True),
    "dr_cyclegan": Variant("both", "randomised", translated=True),
}


def episodes(options: SixModelsOptions) -> dict[str, int]:
    """Of each test."""
    return {"laps": options.lap_drives, "paths": PATHS, "tasks": MISSIONS}


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


def models(options: SixModelsOptions) -> list[Model]:
    """All that can be trained: seed by seed, each in the order of the paper's tables."""
    return [
        Model(algorithm, name, seed)
        for seed in range(options.seeds)
        for name, variant in VARIANTS.items()
        if options.translator is not None or not variant.translated
        for algorithm in ALGORITHMS
    ]


def trainings(out: Path, options: SixModelsOptions, among: Sequence[Model]) -> list[TrainJob]:
    """Two for each of these models."""
    jobs = []
    for model in among:
        variant = VARIANTS[model.variant]
        for task in ("navigation", "lane"):
            guided = task == "navigation"
            steps = options.ppo_steps if model.algorithm == "ppo" else options.steps
            job = TrainOptions(
                task=task,
                algo=model.algorithm,
                preset=options.preset,
                map=options.map if guided else (),
                steps=steps if guided else options.lane_steps,
                seed=model.seed,
                look=variant.look,
                pose_error=options.pose_error if guided else None,
                translate=options.translator if variant.translated else None,
                judgings=options.judgings,
                full=True,
            )
            jobs.append(TrainJob(model.run(out, task), job, resume=True))
    return jobs


def drives(out: Path, options: SixModelsOptions, among: Sequence[Model]) -> list[EvaluateJob]:
    """The three tests of each of these models. The policy sees what is there, untranslated."""
    places: dict[str, tuple[str, tuple[str, ...], str | None]] = {
        "laps": ("four_laps", (), None),
        "paths": ("manoeuvres", (options.test_map,), options.pose_error),
        "tasks": ("navigation", (options.test_map,), options.pose_error),
    }
    jobs = []
    for model in among:
        for test, (task, maps, pose_error) in places.items():
            file = model.judged(out, test)
            job = EvaluateOptions(
                model=str(RunFolder(file.parent).onnx),
                task=task,
                map=maps,
                look=options.look,
                pose_error=pose_error,
                episodes=episodes(options)[test],
                seed=FIRST_SEED,
            )
            jobs.append(EvaluateJob(file, job, drives=True))
    return jobs


def of_kind(all_models: Sequence[Model], algorithm: str, variant: str) -> list[Model]:
    """The models that differ by their seeds only."""
    return [m for m in all_models if (m.algorithm, m.variant) == (algorithm, variant)]
