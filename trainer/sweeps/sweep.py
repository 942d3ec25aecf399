"""Many trainings or evaluations with one command: seeds, and options crossed with each other."""

from __future__ import annotations

import itertools
import os
import re
from collections.abc import Sequence
from concurrent import futures
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from rich.console import Console
from rich.progress import MofNCompleteColumn, Progress

from robot.command_line import INTERRUPTED
from robot.errors import ConfigError
from robot.typed_config import from_plain, read_yaml, to_plain
from trainer.sweeps.workers import LocalWorkers, RayWorkers, last_words

T = TypeVar("T")
STOPPING_S = 60.0  # for runs to write their checkpoints
_COLUMNS = (*Progress.get_default_columns(), MofNCompleteColumn())

if TYPE_CHECKING:
    from trainer.sweeps.workers import Job


@dataclass(frozen=True)
class WorkerOptions:
    """Who does many jobs."""

    workers: int | None = None
    """Processes: of one training, or of many jobs at once; else one for each core."""
    ray: str | None = None
    """On a Ray cluster: its address, or auto. All its nodes must share this folder."""


@dataclass(frozen=True)
class SweepOptions(WorkerOptions):
    """Several runs in the place of one."""

    seeds: int | None = None
    """So many, with the seeds from --seed on; those that are finished are skipped."""
    matrix: Path | None = None
    """A YAML file of options, each with a list of values: all combinations."""

    @property
    def wanted(self) -> bool:
        """Whether any were asked for."""
        return self.seeds is not None or self.matrix is not None


def combinations(options: T, many: SweepOptions, seed_step: int = 1) -> list[tuple[str, T]]:
    """Every combination of what is to vary: a name that tells what is its own, and its options.

    ``options`` is a frozen dataclass; ``seed_step`` from one of ``--seeds`` to the next.
    ConfigError for an unknown option, a value of the wrong kind, or two equal combinations.
    """
    choices = _choices(options, many, seed_step)
    found: dict[str, T] = {}
    for values in itertools.product(*choices.values()):
        chosen = dict(zip(choices, values, strict=True))
        name = "_".join(f"{key}-{_slug(value)}" for key, value in chosen.items())
        if name in found:
            raise ConfigError(f"{many.matrix}: expected different values, got {name} twice")
        plain = {**to_plain(options), **chosen}
        found[name] = from_plain(type(options), plain, where=str(many.matrix or "options"))
    return list(found.items())


def run_sweep(jobs: Sequence[Job], many: WorkerOptions, console: Console) -> int:
    """Do all jobs that are not finished; 0, or 1 when any failed.

    DuckpilotError if a job cannot be done at all; then none was begun.
    """
    waiting = []
    for job in jobs:
        if job.finished():
            console.print(f"{job.title}: finished before", markup=False)
        else:
            waiting.append(job)
    if not waiting:
        return 0
    workers = _workers(many)
    asked = {workers.submit(job): job for job in waiting}
    failures: list[str] = []
    try:
        with Progress(*_COLUMNS, console=console) as bar:
            for done in bar.track(futures.as_completed(asked), len(asked), description="jobs"):
                status, said = last_words(asked[done], done)
                if status == 0:
                    console.print(said, markup=False)
                else:
                    job = asked[done]
                    failures.append(f"{job.title}: failed, {said} (see {job.log})")
    except KeyboardInterrupt:
        workers.stop()
        futures.wait(asked, STOPPING_S)
        console.print("interrupted; the same command goes on")
        return INTERRUPTED
    finally:
        workers.close()
    for text in failures:
        console.print(text, style="red", markup=False)
    console.print(f"{len(asked) - len(failures)} of {len(asked)} done")
    return 1 if failures else 0


def _workers(many: WorkerOptions) -> LocalWorkers | RayWorkers:
    if many.ray is not None:
        return RayWorkers(many.ray)
    count = len(os.sched_getaffinity(0)) if many.workers is None else many.workers
    if count < 1:
        raise ConfigError(f"workers: expected 1 or more, got {count}")
    return LocalWorkers(count)


def _choices(options: Any, many: SweepOptions, seed_step: int) -> dict[str, list[Any]]:
    """For each option that varies the values that it has, in the order of the file."""
    choices: dict[str, list[Any]] = {}
    given = {} if many.matrix is None else read_yaml(many.matrix)
    if not isinstance(given, dict):
        raise ConfigError(
            f"{many.matrix}: expected options with lists of values, got {type(given).__name__}"
        )
    for key, values in given.items():
        if not isinstance(values, list) or not values:
            raise ConfigError(f"{many.matrix}: {key}: expected a list of values, got {values!r}")
        name = str(key).replace("-", "_")
        several = isinstance(getattr(options, name, None), tuple)
        choices[name] = [[v] if several and isinstance(v, str) else v for v in values]
    if many.seeds is not None:
        if many.seeds < 1 or "seed" in choices:
            raise ConfigError(
                f"seeds: expected 1 or more, and no seed in the matrix, got {many.seeds}"
            )
        choices["seed"] = [options.seed + k * seed_step for k in range(many.seeds)]
    return choices


def _slug(value: Any) -> str:
    if isinstance(value, list):
        return "+".join(map(_slug, value))
    return re.sub(r"[^A-Za-z0-9.]+", "-", str(value)).strip("-")
