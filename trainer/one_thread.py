"""Processes that keep to one core each: libraries that take all cores get in each other's way.

numba and OpenMP make their threads when they are imported, so the environment must tell them.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from multiprocessing import forkserver
from multiprocessing.process import BaseProcess
from typing import Any

ONE_THREAD = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "NUMBA_NUM_THREADS": "1"}


@contextmanager
def one_thread_each() -> Iterator[None]:
    """Processes that are started meanwhile have one thread; this one keeps what it has."""
    before = dict(os.environ)
    os.environ.update(ONE_THREAD)
    try:
        yield
    finally:
        os.environ.clear()
        os.environ.update(before)


def send_out(do: Callable[..., None], *orders: Any) -> BaseProcess:
    """A process of this program that does so; a server that has imported everything forks it.

    That is quick, and no threads are copied.
    """
    from torch import multiprocessing

    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload(["trainer.training.crew"])
    with one_thread_each():
        forkserver.ensure_running()
    process: BaseProcess = context.Process(target=do, args=orders, daemon=True)
    process.start()
    return process
