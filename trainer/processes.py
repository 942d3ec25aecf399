"""Processes that work at once, on this machine or on a Ray cluster, a core each.

Libraries that take all cores get in each other's way. numba and OpenMP make their threads when they
are imported, so the environment must tell them.
"""

import logging
import multiprocessing
import os
import signal
import subprocess
import sys
import time
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager, suppress
from multiprocessing import forkserver
from multiprocessing.process import BaseProcess
from threading import Thread
from typing import Any, NamedTuple, Protocol, TypeVar

from robot.command_line import one_line
from robot.errors import ConfigError, DuckpilotError

ONE_THREAD = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "NUMBA_NUM_THREADS": "1"}
ANSWER_S = 15.0  # that a cluster may take to answer
_LEAVE_S = 5.0  # that processes get to leave in order
_LOOK_S = 0.1  # between two looks whether any have ended
_TRY = "import sys, ray; ray.init(sys.argv[1], log_to_driver=False, logging_level='ERROR')"


class Part(Protocol):
    """A part of some work, the same whoever does it, which other processes can be sent."""

    def done(self) -> bool:
        """Whether its file is there, whole."""

    def write(self) -> None:
        """Do it, and write its file."""


AnyPart = TypeVar("AnyPart", bound=Part)


class Ended(NamedTuple):
    """How a process ended."""

    status: int  # what it returned or exited with; below 0, the signal that killed it
    said: str  # why, where that is known


class LocalProcesses:
    """Of this machine: a server that has imported everything forks them, fast, with no threads."""

    host = "127.0.0.1"

    def __init__(self) -> None:
        self.cores = len(os.sched_getaffinity(0))
        self._started: list[BaseProcess] = []

    def start(self, do: Callable[..., object], *orders: Any) -> BaseProcess:
        """One more, that does so and exits with what it returns; or is ended with this process."""
        process: BaseProcess = _server().Process(target=_do, args=(do, *orders))
        process.start()
        self._started.append(process)
        return process

    def ended(self, process: BaseProcess) -> Ended | None:
        """How it ended; None while it lives."""
        if (code := process.exitcode) is None:
            return None
        return Ended(code, f"killed by {signal.Signals(-code).name}" if code < 0 else "")

    def close(self, within_s: float = _LEAVE_S) -> None:
        """Ask all to leave, and end who has not left within this time."""
        until = time.monotonic() + within_s
        for process in self._started:
            process.terminate()
        for process in self._started:
            process.join(max(0.0, until - time.monotonic()))
            process.kill()
            process.join()
        self._started = []


def _server() -> Any:
    from torch import multiprocessing

    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload(["trainer.training.crew", "trainer.judging.challenge"])
    before = dict(os.environ)
    os.environ.update(ONE_THREAD)  # this process keeps what it has
    try:
        forkserver.ensure_running()
    finally:
        os.environ.clear()
        os.environ.update(before)
    return context


@contextmanager
def pool() -> Iterator[Callable[..., Iterator[Any]]]:
    """As ``map``, but on all cores. DuckpilotError: one of the processes was killed."""
    workers = ProcessPoolExecutor(len(os.sched_getaffinity(0)), _server(), _alone)
    try:
        yield workers.map
    except BrokenProcessPool as error:
        raise DuckpilotError("expected processes to end in order, got one killed") from error
    finally:
        workers.shutdown(cancel_futures=True)


class RayProcesses:
    """Of a Ray cluster, see `LocalProcesses`; one that died begins again elsewhere, so many times.

    ConfigError if no cluster answers at this address, or it has fewer GPUs than each is to have.
    """

    def __init__(self, address: str, retries: int = 0, gpus: float = 0.0) -> None:
        self._ray = connect(address)
        # a process for each, so that none inherits another's threads and open files
        self._how = {"num_cpus": 1, "num_gpus": gpus, "max_retries": retries, "max_calls": 1}
        self.host, found = self._ray.util.get_node_ip_address(), self._ray.cluster_resources()
        self.cores = 1 + int(found.get("CPU", 0))  # with this process's own
        if gpus > (most := found.get("GPU", 0.0)):
            raise ConfigError(f"gpus: expected at most the cluster's {most:g}, got {gpus:g}")
        self._started: list[Any] = []

    def start(self, do: Callable[..., object], *orders: Any) -> Any:
        """As soon as a core is free."""
        self._started.append(self._ray.remote(**self._how)(do).remote(*orders))
        return self._started[-1]

    def ended(self, reference: Any) -> Ended | None:
        """See `LocalProcesses`."""
        if not self._ray.wait([reference], timeout=0)[0]:
            return None
        try:
            return Ended(self._ray.get(reference) or 0, "")
        except self._ray.exceptions.RayError as error:
            return Ended(1, str(error).strip().splitlines()[-1])

    def close(self, within_s: float = 0.0) -> None:
        """See `LocalProcesses`; the cluster goes on."""
        for reference in self._going(0.0) if within_s else ():
            self._ray.cancel(reference)
        for reference in self._going(within_s):
            self._ray.cancel(reference, force=True)
        self._started = []

    def _going(self, after_s: float) -> list[Any]:
        # Ray ends this process when told to cancel what has given its result a moment ago.
        going: list[Any] = self._ray.wait(
            self._started, num_returns=len(self._started), timeout=after_s
        )[1]
        return going


Processes = LocalProcesses | RayProcesses


def processes_of(ray: str | None, retries: int = 0, gpus: float = 0.0) -> Processes:
    """Of this machine, or of the Ray cluster at an address; ConfigError as of `RayProcesses`."""
    if ray is None and gpus:
        raise ConfigError(f"gpus: expected --ray as well, got {gpus:g}; here there is --device")
    return LocalProcesses() if ray is None else RayProcesses(ray, retries, gpus)


def at_once(
    processes: Processes, most: int, do: Callable[..., object], orders: Iterable[tuple[Any, ...]]
) -> Iterator[tuple[tuple[Any, ...], Ended]]:
    """Carry out all orders, so many at a time; each, and how it ended, as it does."""
    waiting, going = deque(orders), list[tuple[Any, tuple[Any, ...]]]()
    while waiting or going:
        while waiting and len(going) < most:
            order = waiting.popleft()
            going.append((processes.start(do, *order), order))
        for each in list(going):
            if ended := processes.ended(each[0]):
                going.remove(each)
                yield each[1], ended
        time.sleep(_LOOK_S)


def shared(parts: Iterable[AnyPart], most: int | None = None) -> Iterator[AnyPart]:
    """Do what is not done, so many at a time, else one on each core; each part, once it is done.

    In this process, where there is nothing to share. Errors as of the parts.
    """
    left = list[AnyPart]()
    for part in parts:
        if part.done():
            yield part
        else:
            left.append(part)
    processes = LocalProcesses()
    most = min(most or processes.cores, len(left))
    try:
        orders = [(part, os.getcwd()) for part in left] if most > 1 else []
        for (part, _), _ in at_once(processes, most, _write, orders):
            left.remove(part)
            if not part.done():  # killed, or refused; then it is here, where that is told
                part.write()
            yield part
    finally:
        processes.close()
    for part in left:
        part.write()
        yield part


def _write(part: Part, folder: str) -> None:
    """In a process that is for nothing else."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is the affair of who asked
    signal.signal(signal.SIGTERM, lambda *_: sys.exit())  # in order
    os.chdir(folder)
    with suppress(DuckpilotError):
        part.write()


def connect(address: str) -> Any:
    """The module ray, connected; ConfigError if no cluster answers."""
    import ray

    told = f"no answer in {ANSWER_S:.0f} s"
    # In a process that can be ended: Ray itself waits for a quarter of an hour.
    with suppress(subprocess.TimeoutExpired):
        command = [sys.executable, "-c", _TRY, address]
        tried = subprocess.run(command, capture_output=True, timeout=ANSWER_S, check=False)
        told = one_line(tried.stderr.decode(errors="replace"))[-200:] if tried.returncode else ""
    if told:
        expected = "the address of a running cluster (ray start --head)"
        raise ConfigError(f"ray {address!r}: expected {expected}, got: {told}")
    quiet: dict[str, Any] = {"log_to_driver": False, "logging_level": logging.ERROR}
    ray.init(address, ignore_reinit_error=True, runtime_env={"env_vars": ONE_THREAD}, **quiet)
    return ray


def _alone() -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is the affair of who asked
    Thread(target=_stop_with_parent, daemon=True).start()


def _do(do: Callable[..., object], *orders: Any) -> None:
    Thread(target=_stop_with_parent, daemon=True).start()
    status = do(*orders)
    sys.exit(status if isinstance(status, int) else 0)


def _stop_with_parent() -> None:
    parent = multiprocessing.parent_process()
    assert parent is not None
    parent.join()
    os.kill(os.getpid(), signal.SIGTERM)
