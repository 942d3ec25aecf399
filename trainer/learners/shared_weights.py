"""What A3C's processes read and write together, without locks.

The memory is an unnamed file that every process maps. Unlike torch's shared tensors it does not
need /dev/shm, which many containers keep small or read-only; and nothing is left of it when the
last process ends, however it ends.
"""

from __future__ import annotations

import mmap
import os
import sys
import tempfile
from collections.abc import Callable
from multiprocessing.reduction import DupFd
from typing import Any

import numpy as np
import torch

_FLOAT, _COUNT = np.dtype(np.float32), np.dtype(np.int64)


class Shared:
    """Weights, RMSProp's statistics and counters; a process gets them with its arguments.

    Args:
        file: descriptor of a file that is large enough, see `Shared.of`.
        parameters: P, of the policy.
        workers: W.
    """

    def __init__(self, file: int, parameters: int, workers: int) -> None:
        self._file, self._parameters, self._workers = file, parameters, workers
        memory = mmap.mmap(file, _size(parameters, workers))
        counts = np.frombuffer(memory, _COUNT, 2 * workers + 1)
        floats = np.frombuffer(memory, _FLOAT, 2 * parameters, counts.nbytes)
        # Each worker writes its own; (W,) both:
        self.steps = torch.from_numpy(counts[:workers])  # decisions
        self.cpu_ms = torch.from_numpy(counts[workers:-1])  # milliseconds of CPU, of processes
        self._stop = torch.from_numpy(counts[-1:])
        self.weights, self.squares = torch.from_numpy(floats).split(parameters)  # (P,) both

    @classmethod
    def of(cls, weights: torch.Tensor, squares: torch.Tensor, workers: int) -> Shared:
        """Fresh memory with a copy of these weights (P,) and statistics (P,)."""
        file = _unnamed_file()
        os.ftruncate(file, _size(len(weights), workers))
        shared = cls(file, len(weights), workers)
        shared.weights.copy_(weights)
        shared.squares.copy_(squares)
        return shared

    @property
    def stopped(self) -> bool:
        """Whether the workers shall leave."""
        return bool(self._stop[0])

    def stop(self) -> None:
        """Tell the workers to leave."""
        self._stop[0] = 1

    def __reduce__(self) -> tuple[Callable[..., Shared], tuple[Any, int, int]]:
        return _received, (DupFd(self._file), self._parameters, self._workers)

    def __del__(self) -> None:
        os.close(self._file)


def _received(file: Any, parameters: int, workers: int) -> Shared:
    return Shared(file.detach(), parameters, workers)


def _size(parameters: int, workers: int) -> int:
    """In bytes."""
    return (2 * workers + 1) * _COUNT.itemsize + 2 * parameters * _FLOAT.itemsize


def _unnamed_file() -> int:
    if sys.platform == "linux":
        return os.memfd_create("a3c")
    with tempfile.TemporaryFile() as file:
        return os.dup(file.fileno())
