"""Jobs in processes of their own: on this machine, or on a Ray cluster."""

from __future__ import annotations

import logging
import multiprocessing
import os
import signal
import socket
import sys
import threading
from multiprocessing.connection import wait
from multiprocessing.process import BaseProcess
from pathlib import Path
from typing import Any, NamedTuple, Protocol

from rich.console import Console

from robot.errors import ConfigError, DuckpilotError
from trainer.one_thread import ONE_THREAD, one_thread_each

RETRIES = 5  # of a job whose Ray worker or node died; it goes on from its checkpoint
STOPPING_S = 60.0  # for a run to write its checkpoint


class Progressed(NamedTuple):
    """How far a job has come."""

    done: float
    total: float  # 0 where nobody knows
    text: str


class Job(Protocol):
    """One training or evaluation; goes to another process as it is, and may be begun again."""

    @property
    def title(self) -> str:
        """What people call it."""

    @property
    def log(self) -> Path:
        """Where another process writes what this one would print."""

    def finished(self) -> bool:
        """Whether its results lie there already.

        Raises:
            DuckpilotError: it cannot be done, or results of something else lie there.
        """

    def progress(self) -> Progressed:
        """Read from the files that it writes."""

    def run(self, console: Console) -> int:
        """Do it; the exit status."""


class Outcome(NamedTuple):
    """A job that has ended."""

    job: Job
    status: int  # 0: done
    said: str  # one line


class Workers(Protocol):
    """Processes that do jobs."""

    @property
    def busy(self) -> bool:
        """Whether any job has not ended."""

    @property
    def room(self) -> bool:
        """Whether another job may be started."""

    def start(self, job: Job) -> None:
        """Begin one."""

    def ended(self, timeout_s: float) -> list[Outcome]:
        """Those that have ended since the last call; waits for the first of them."""

    def stop(self) -> None:
        """Ask all to stop with a checkpoint."""

    def close(self) -> None:
        """Let go of the processes."""


class LocalWorkers:
    """Up to ``count`` processes on this machine."""

    def __init__(self, count: int) -> None:
        self._count = count
        self._context = multiprocessing.get_context("spawn")
        self._running: dict[BaseProcess, Job] = {}

    @property
    def busy(self) -> bool:
        """As of `Workers`."""
        return bool(self._running)

    @property
    def room(self) -> bool:
        """As of `Workers`."""
        return len(self._running) < self._count

    def start(self, job: Job) -> None:
        """As of `Workers`."""
        process = self._context.Process(target=_live, args=(job, os.getcwd()), name=job.title)
        with one_thread_each():
            process.start()
        self._running[process] = job

    def ended(self, timeout_s: float) -> list[Outcome]:
        """As of `Workers`."""
        wait([process.sentinel for process in self._running], timeout_s)
        outcomes = []
        for process in [p for p in self._running if p.exitcode is not None]:
            job, status = self._running.pop(process), process.exitcode or 0
            said = _last_line(job.log)
            if status < 0:
                said = f"killed by {signal.Signals(-status).name}; the same command goes on with it"
            outcomes.append(Outcome(job, status, said))
            process.close()
        return outcomes

    def stop(self) -> None:
        """As of `Workers`."""
        for process in self._running:
            process.terminate()
        for process in self._running:
            process.join(STOPPING_S)

    def close(self) -> None:
        """As of `Workers`; a process that did not stop is killed."""
        for process in self._running:
            process.kill()
            process.join()


class RayWorkers:
    """The workers of a Ray cluster, one core for each job; Ray queues what has no room yet.

    A job whose worker or node dies is begun again elsewhere, up to `RETRIES` times.

    Raises:
        ConfigError: Ray is not installed, or no cluster answers.
    """

    def __init__(self, address: str) -> None:
        try:
            import ray
        except ImportError as error:
            raise ConfigError(
                "ray: expected the package ray, found none; install duckpilot[scale]"
            ) from error
        self._ray: Any = ray
        try:
            ray.init(
                address=address,
                log_to_driver=False,
                logging_level=logging.ERROR,
                runtime_env={"env_vars": ONE_THREAD},
            )
        except (ConnectionError, ValueError) as error:
            raise ConfigError(
                f"ray {address!r}: expected the address of a running cluster (ray start --head), "
                f"got: {error}"
            ) from error
        # one process for each job, so that none inherits another's threads and open files
        self._do = ray.remote(num_cpus=1, max_retries=RETRIES, max_calls=1)(perform)
        self._running: dict[Any, Job] = {}

    @property
    def busy(self) -> bool:
        """As of `Workers`."""
        return bool(self._running)

    @property
    def room(self) -> bool:
        """As of `Workers`."""
        return True

    def start(self, job: Job) -> None:
        """As of `Workers`."""
        self._running[self._do.remote(job, os.getcwd())] = job

    def ended(self, timeout_s: float) -> list[Outcome]:
        """As of `Workers`."""
        ready, _ = self._ray.wait(list(self._running), timeout=timeout_s)
        outcomes = []
        for reference in ready:
            job = self._running.pop(reference)
            try:
                status = int(self._ray.get(reference))
                outcomes.append(Outcome(job, status, _last_line(job.log)))
            except self._ray.exceptions.RayError as error:
                outcomes.append(Outcome(job, 1, str(error).strip().splitlines()[-1]))
        return outcomes

    def stop(self) -> None:
        """As of `Workers`."""
        for reference in self._running:
            self._ray.cancel(reference)
        self._ray.wait(list(self._running), num_returns=len(self._running), timeout=STOPPING_S)

    def close(self) -> None:
        """As of `Workers`; the cluster goes on."""
        self._ray.shutdown()


def perform(job: Job, folder: str) -> int:
    """Do a job in this process, which it may keep for itself; the exit status.

    Args:
        job: all that it and its libraries print goes to its log.
        folder: where relative paths begin, on every machine the same one.

    Raises:
        ConfigError: this machine does not have the folder.
    """
    if not Path(folder).is_dir():
        raise ConfigError(
            f"{folder}: expected a folder that all nodes of the cluster share, found none on "
            f"{socket.gethostname()}"
        )
    os.chdir(folder)
    job.log.parent.mkdir(parents=True, exist_ok=True)
    log = os.open(job.log, os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o644)
    for stream in (1, 2):
        os.dup2(log, stream)
    os.close(log)
    with open(1, "w", encoding="utf-8", closefd=False) as printed:
        console = Console(file=printed, soft_wrap=True)
        try:
            return job.run(console)
        except DuckpilotError as error:
            console.print(str(error), markup=False)
            return 2


def _live(job: Job, folder: str) -> None:
    """A process of `LocalWorkers`; stops with a checkpoint when its parent is gone."""
    threading.Thread(target=_stop_with_parent, daemon=True).start()
    sys.exit(perform(job, folder))


def _stop_with_parent() -> None:
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os.kill(os.getpid(), signal.SIGTERM)


def _last_line(log: Path) -> str:
    lines = log.read_text(encoding="utf-8", errors="replace").split("\n") if log.exists() else []
    return next((line.strip() for line in reversed(lines) if line.strip()), "nothing was printed")
