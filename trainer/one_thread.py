"""Processes that keep to one core each: libraries that take all cores get in each other's way.

numba and OpenMP make their threads when they are imported, so the environment must tell them.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager

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
