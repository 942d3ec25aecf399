"""How sure a figure over episodes is, and whether two drivers differ."""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

_DRAWS = 2000


class Estimate(NamedTuple):
    """A figure and its 95 % interval."""

    value: float
    low: float
    high: float


def share(successes: int, episodes: int) -> Estimate:
    """Of successes, with the interval of Wilson 1927."""
    from scipy.stats import binomtest

    low, high = binomtest(successes, episodes).proportion_ci(method="wilson")
    return Estimate(successes / episodes, float(low), float(high))


def median(values: Sequence[float]) -> Estimate:
    """With the percentile bootstrap's interval (Efron 1979)."""
    every = np.asarray(values, dtype=float)
    return Estimate(float(np.median(every)), *bootstrap(every, np.median))


def bootstrap(
    values: np.ndarray, statistic: Callable[..., np.ndarray], block: int = 1
) -> tuple[float, float]:
    """95 % interval of a statistic of (N,) values; the same again for the same values.

    Of values in order of time whose neighbours are alike, whole blocks are drawn together, in a
    circle (Politis and Romano 1992).
    """
    count = len(values)
    block = min(block, count)
    starts = np.random.default_rng(0).integers(count, size=(_DRAWS, -(-count // block)))
    drawn = (starts[..., None] + np.arange(block)) % count
    found = statistic(values[drawn.reshape(_DRAWS, -1)[:, :count]], axis=1)
    low, high = np.quantile(found, (0.025, 0.975)).tolist()
    return low, high


def paired(first: Sequence[bool], second: Sequence[bool]) -> dict[str, float]:
    """Compare two drivers by the episodes that only one of them did: McNemar's exact test."""
    from scipy.stats import binomtest

    differ = [a for a, b in zip(first, second, strict=True) if a != b]
    wins, losses = sum(differ), len(differ) - sum(differ)
    p_value = float(binomtest(wins, len(differ)).pvalue) if differ else 1.0
    return {"only_first": wins, "only_second": losses, "p_value": p_value}
