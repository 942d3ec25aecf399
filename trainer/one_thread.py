"""Processes that keep to one core each.

Libraries that take all cores for themselves would only be in each other's way; numba and OpenMP
make their threads when they are imported, so it is the environment of a process that tells them.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager

ONE_THREAD = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "NUMBA_NUM_THREADS": "1"}


@contextmanager
def one_thread_each() -> Iterator[None]:
    """Processes that are started meanwhile have one thread; this one keeps what it has."""
    before = {name: os.environ.get(name) for name in ONE_THREAD}
    os.environ.update(ONE_THREAD)
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value
