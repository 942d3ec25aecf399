"""A job in a process of its own, and what it said last."""

import os
import socket
from pathlib import Path
from typing import TYPE_CHECKING, TypeAlias

from rich.console import Console

from robot.errors import ConfigError, DuckpilotError
from trainer.processes import Ended

if TYPE_CHECKING:
    from trainer.sweeps.jobs import EvaluateJob, TrainJob

Job: TypeAlias = "TrainJob | EvaluateJob"


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
        raise ConfigError(
            f"{folder}: expected a folder that all nodes of the cluster share, found none on "
            f"{socket.gethostname()}"
        )
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
