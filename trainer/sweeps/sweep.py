"""Many trainings or evaluations with one command: seeds, and options crossed with each other."""

from __future__ import annotations

import os
from collections.abc import Sequence
from concurrent import futures
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from rich.console import Console
from rich.progress import MofNCompleteColumn, Progress

from robot.command_line import INTERRUPTED
from robot.errors import ConfigError
from trainer.sweeps.workers import LocalWorkers, RayWorkers, last_words

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
