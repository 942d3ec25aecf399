"""Jobs in processes of their own: on this machine, or on a Ray cluster."""

from __future__ import annotations

import logging
import multiprocessing
import os
import signal
import socket
import subprocess
import sys
import threading
from concurrent.futures import Future, ThreadPoolExecutor
from multiprocessing.process import BaseProcess
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

from rich.console import Console

from robot.command_line import one_line
from robot.errors import ConfigError, DuckpilotError
from trainer.one_thread import ONE_THREAD, one_thread_each

if TYPE_CHECKING:
    from trainer.sweeps.jobs import EvaluateJob, TrainJob

    Job: TypeAlias = TrainJob | EvaluateJob

RETRIES = 5  # of a job whose Ray worker or node died; it goes on from its checkpoint
ANSWER_S = 15.0  # that a cluster may take to answer
_TRY = "import sys, ray; ray.init(sys.argv[1], log_to_driver=False, logging_level='ERROR')"


class LocalWorkers:
    """Up to ``count`` processes on this machine."""

    def __init__(self, count: int) -> None:
        self._threads = ThreadPoolExecutor(count)
        self._starting = threading.Lock()  # the environment is the same for all
        self._running: set[BaseProcess] = set()

    def submit(self, job: Job) -> Future[int]:
        """Do a job when there is room; its exit status, below 0 where a signal killed it."""
        return self._threads.submit(self._do, job)

    def stop(self) -> None:
        """Ask all to stop with a checkpoint, and begin none of the rest."""
        self._threads.shutdown(wait=False, cancel_futures=True)
        for process in list(self._running):
            process.terminate()

    def close(self) -> None:
        """Let go of the processes; one that has not stopped yet is killed."""
        self._threads.shutdown(wait=False, cancel_futures=True)
        for process in list(self._running):
            process.kill()

    def _do(self, job: Job) -> int:
        context = multiprocessing.get_context("spawn")
        process = context.Process(target=_live, args=(job, os.getcwd()))
        with self._starting, one_thread_each():
            process.start()
        self._running.add(process)
        process.join()
        self._running.discard(process)
        return process.exitcode or 0


class RayWorkers:
    """A Ray cluster, one core for each job; jobs whose worker or node dies begin again elsewhere.

    ConfigError if Ray is not installed, or no cluster answers.
    """

    def __init__(self, address: str) -> None:
        self._ray = connect(address)
        # one process for each job, so that none inherits another's threads and open files
        self._perform = self._ray.remote(num_cpus=1, max_retries=RETRIES, max_calls=1)(perform)
        self._references: list[Any] = []

    def submit(self, job: Job) -> Future[int]:
        """As of `LocalWorkers`."""
        self._references.append(self._perform.remote(job, os.getcwd()))
        status: Future[int] = self._references[-1].future()
        return status

    def stop(self) -> None:
        """As of `LocalWorkers`."""
        for reference in self._references:
            self._ray.cancel(reference)

    def close(self) -> None:
        """Let go of the cluster, which goes on."""
        self._ray.shutdown()


def connect(address: str) -> Any:
    """The module ray, connected; ConfigError if it is not installed, or no cluster answers."""
    try:
        import ray
    except ImportError as error:
        raise ConfigError(
            "ray: expected the package ray, found none; install duckpilot[scale]"
        ) from error
    told = f"no answer in {ANSWER_S:.0f} s"
    try:  # in a process that can be ended: Ray itself waits for a quarter of an hour
        command = [sys.executable, "-c", _TRY, address]
        tried = subprocess.run(command, capture_output=True, timeout=ANSWER_S, check=False)
        told = one_line(tried.stderr.decode(errors="replace"))[-200:] if tried.returncode else ""
    except subprocess.TimeoutExpired:
        pass
    if told:
        raise ConfigError(
            f"ray {address!r}: expected the address of a running cluster (ray start --head), "
            f"got: {told}"
        )
    environment = {"env_vars": ONE_THREAD}
    ray.init(address, log_to_driver=False, logging_level=logging.ERROR, runtime_env=environment)
    return ray


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


def last_words(job: Job, done: Future[int]) -> tuple[int, str]:
    """The exit status of a job that has ended, and in one line what it said last."""
    if (error := done.exception()) is not None:  # of Ray
        return 1, str(error).strip().splitlines()[-1]
    if (status := done.result()) < 0:
        name = signal.Signals(-status).name
        return status, f"killed by {name}; the same command goes on with it"
    text = job.log.read_text(encoding="utf-8", errors="replace") if job.log.exists() else ""
    return status, next((s for s in reversed(text.splitlines()) if s.strip()), "printed nothing")


def _live(job: Job, folder: str) -> None:
    """A process of `LocalWorkers`; stops with a checkpoint when its parent is gone."""
    threading.Thread(target=_stop_with_parent, daemon=True).start()
    sys.exit(perform(job, folder))


def _stop_with_parent() -> None:
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os.kill(os.getpid(), signal.SIGTERM)
