"""Many trainings or evaluations with one command: seeds, and options crossed with each other."""

import os
import socket
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, TypeAlias

from rich.console import Console
from rich.progress import MofNCompleteColumn, Progress

from robot.command_line import INTERRUPTED
from robot.errors import ConfigError, DuckpilotError
from trainer.options import WorkerOptions
from trainer.processes import Ended, at_once, processes_of

if TYPE_CHECKING:
    from trainer.sweeps.jobs import EvaluateJob, TrainJob

RETRIES = 5  # of a job whose Ray worker or node died; it goes on from its checkpoint
STOPPING_S = 60.0  # for runs to write their checkpoints
_COLUMNS = (*Progress.get_default_columns(), MofNCompleteColumn())
Job: TypeAlias = "TrainJob | EvaluateJob"


def run_sweep(jobs: Sequence[Job], many: WorkerOptions, console: Console) -> int:
    """Do all jobs that are not finished; 0, or 1 when any failed.

    DuckpilotError if a job cannot be done at all; then none was begun.
    """
    waiting = [job for job in jobs if not job.finished()]
    for job in jobs:
        if job not in waiting:
            console.print(f"{job.out}: finished before", markup=False)
    if not waiting:
        return 0
    failures = list[str]()
    processes = processes_of(many.ray, RETRIES, many.gpus)
    most = (many.workers or processes.cores) if many.ray is None else len(waiting)
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
                    failures.append(f"{job.out}: failed, {said} (see {job.log})")
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


def last_words(job: Job, ended: Ended) -> str:
    """Why a job has ended, or what it said last, in a line."""
    if ended.said:
        return f"{ended.said}; the same command goes on with it" if ended.status < 0 else ended.said
    text = job.log.read_text(encoding="utf-8", errors="replace") if job.log.exists() else ""
    return next((s for s in reversed(text.splitlines()) if s.strip()), "printed nothing")


def perform(job: Job, folder: str) -> int:
    """Do a job in this process, which it may keep for itself; the exit status.

    All that is printed goes to the job's log; relative paths begin in ``folder``: ConfigError if
    this machine has none.
    """
    if not Path(folder).is_dir():
        told = f"{folder}: expected a folder that all nodes of the cluster share, found none on "
        raise ConfigError(f"{told}{socket.gethostname()}")
    os.chdir(folder)
    job.log.parent.mkdir(parents=True, exist_ok=True)
    with job.log.open("ab") as log:
        for stream in (1, 2):
            os.dup2(log.fileno(), stream)
    with open(1, "w", encoding="utf-8", closefd=False) as printed:
        console = Console(file=printed, soft_wrap=True)
        try:
            return job.run(console)
        except DuckpilotError as error:
            console.print(str(error), markup=False)
            return 2
