"""Jobs in processes of their own: on this machine, or on a Ray cluster."""

from __future__ import annotations

import logging
import multiprocessing
import os
import signal
import socket
import sys
import threading
from abc import ABC, abstractmethod
from collections.abc import Callable
from concurrent import futures
from concurrent.futures import Future, ThreadPoolExecutor
from multiprocessing.process import BaseProcess
from pathlib import Path
from typing import Any, NamedTuple, Protocol

from rich.console import Console

from robot.errors import ConfigError, DuckpilotError
from trainer.one_thread import ONE_THREAD, one_thread_each

RETRIES = 5  # of a job whose Ray worker or node died; it goes on from its checkpoint
STOPPING_S = 60.0  # for a run to write its checkpoint
_MOST_AT_ONCE = 1_000  # jobs that are awaited on a cluster


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


class Workers(ABC):
    """Threads that each await a job in a process elsewhere."""

    def __init__(self, at_once: int) -> None:
        self._threads = ThreadPoolExecutor(at_once)
        self._futures: list[Future[Outcome]] = []

    def submit(self, job: Job, begun: Callable[[Job], None] = lambda _: None) -> Future[Outcome]:
        """Do a job when there is room; ``begun`` hears when that is."""
        self._futures.append(self._threads.submit(self._await, job, begun))
        return self._futures[-1]

    def stop(self) -> None:
        """Ask all to stop with a checkpoint, and begin none of the rest."""
        self._threads.shutdown(wait=False, cancel_futures=True)
        self._ask_to_stop()
        futures.wait(self._futures, STOPPING_S)

    def close(self) -> None:
        """Let go of the processes."""
        self._threads.shutdown(wait=False, cancel_futures=True)
        self._let_go()

    def _await(self, job: Job, begun: Callable[[Job], None]) -> Outcome:
        begun(job)
        return self._do(job)

    @abstractmethod
    def _do(self, job: Job) -> Outcome: ...

    @abstractmethod
    def _ask_to_stop(self) -> None: ...

    @abstractmethod
    def _let_go(self) -> None: ...


class LocalWorkers(Workers):
    """Up to ``count`` processes on this machine; one that does not stop is killed."""

    def __init__(self, count: int) -> None:
        super().__init__(count)
        self._context = multiprocessing.get_context("spawn")
        self._starting = threading.Lock()  # the environment is the same for all
        self._running: set[BaseProcess] = set()

    def _do(self, job: Job) -> Outcome:
        process = self._context.Process(target=_live, args=(job, os.getcwd()), name=job.title)
        with self._starting, one_thread_each():
            process.start()
        self._running.add(process)
        process.join()
        self._running.discard(process)
        status, said = process.exitcode or 0, _last_line(job.log)
        if status < 0:
            said = f"killed by {signal.Signals(-status).name}; the same command goes on with it"
        return Outcome(job, status, said)

    def _ask_to_stop(self) -> None:
        for process in list(self._running):
            process.terminate()

    def _let_go(self) -> None:
        for process in list(self._running):
            process.kill()


class RayWorkers(Workers):
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
        super().__init__(_MOST_AT_ONCE)
        # one process for each job, so that none inherits another's threads and open files
        self._perform = ray.remote(num_cpus=1, max_retries=RETRIES, max_calls=1)(perform)
        self._running: set[Any] = set()

    def _do(self, job: Job) -> Outcome:
        reference = self._perform.remote(job, os.getcwd())
        self._running.add(reference)
        try:
            return Outcome(job, int(self._ray.get(reference)), _last_line(job.log))
        except self._ray.exceptions.RayError as error:
            return Outcome(job, 1, str(error).strip().splitlines()[-1])
        finally:
            self._running.discard(reference)

    def _ask_to_stop(self) -> None:
        for reference in list(self._running):
            self._ray.cancel(reference)

    def _let_go(self) -> None:
        self._ray.shutdown()  # the cluster goes on


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
