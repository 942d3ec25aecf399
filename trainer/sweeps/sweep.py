"""Many trainings or evaluations with one command: seeds, and options crossed with each other."""

import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from rich.console import Console
from rich.progress import MofNCompleteColumn, Progress

from robot.command_line import INTERRUPTED
from trainer.processes import LocalProcesses, Processes, RayProcesses, at_once
from trainer.sweeps.perform import Job, last_words, perform

RETRIES = 5  # of a job whose Ray worker or node died; it goes on from its checkpoint
STOPPING_S = 60.0  # for runs to write their checkpoints
_COLUMNS = (*Progress.get_default_columns(), MofNCompleteColumn())


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
    waiting = list[Job]()
    for job in jobs:
        if job.finished():
            console.print(f"{job.title}: finished before", markup=False)
        else:
            waiting.append(job)
    if not waiting:
        return 0
    failures = list[str]()
    processes, most = _processes(many, len(waiting))
    orders = [(job, os.getcwd()) for job in waiting]
    try:
        with Progress(*_COLUMNS, console=console) as bar:
            row = bar.add_task("jobs", total=len(waiting))
            for (job, _), ended in at_once(processes, most, perform, orders):
                bar.advance(row)
                said = last_words(job, ended)
                if ended.status == 0:
                    console.print(said, markup=False)
                else:
                    failures.append(f"{job.title}: failed, {said} (see {job.log})")
    except KeyboardInterrupt:
        processes.close(STOPPING_S)
        console.print("interrupted; the same command goes on")
        return INTERRUPTED
    finally:
        processes.close()
    for text in failures:
        console.print(text, style="red", markup=False)
    console.print(f"{len(waiting) - len(failures)} of {len(waiting)} done")
    return 1 if failures else 0


def _processes(many: WorkerOptions, jobs: int) -> tuple[Processes, int]:
    """Who does the jobs, and how many of them are handed over at once."""
    if many.ray is not None:
        return RayProcesses(many.ray, RETRIES), jobs
    processes = LocalProcesses()
    return processes, processes.number(many.workers)
