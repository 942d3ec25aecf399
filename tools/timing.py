"""Timing helpers of the benchmark: enough repetitions, the median, and rates side by side."""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np


def seconds_per_call(work: Callable[[], object], least_s: float = 1.0) -> float:
    """Median wall-clock seconds of a call, over at least ``least_s`` [s] and five calls."""
    work()
    times: list[float] = []
    while len(times) < 5 or sum(times) < least_s:
        begin = time.perf_counter()
        work()
        times.append(time.perf_counter() - begin)
    return float(np.median(times))


def in_turn(first: Callable[[], object], second: Callable[[], object]) -> tuple[float, float]:
    """Median seconds of two calls, measured A B A B, so that a busy machine slows both alike."""
    first(), second()
    times: list[tuple[float, float]] = []
    while len(times) < 5 or sum(map(sum, times)) < 4.0:
        begin = time.perf_counter()
        first()
        middle = time.perf_counter()
        second()
        times.append((middle - begin, time.perf_counter() - middle))
    first_s, second_s = np.median(np.array(times), axis=0)
    return float(first_s), float(second_s)
