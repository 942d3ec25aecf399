"""How sure a figure over episodes is, and whether two drivers differ."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from trainer.judging.evaluate import wilson_low

_DRAWS = 2000


class Estimate(NamedTuple):
    """A figure and its 95 % interval."""

    value: float
    low: float
    high: float


def share(successes: int, episodes: int) -> Estimate:
    """Of successes, with Wilson's interval."""
    low, high = wilson_low(successes, episodes), 1.0 - wilson_low(episodes - successes, episodes)
    return Estimate(successes / episodes, low, high)


def median(values: Sequence[float]) -> Estimate:
    """With the percentile bootstrap's interval (Efron 1979); the same again for the same values."""
    every = np.asarray(values, dtype=float)
    drawn = np.random.default_rng(0).integers(len(every), size=(_DRAWS, len(every)))
    low, high = np.quantile(np.median(every[drawn], axis=1), (0.025, 0.975)).tolist()
    return Estimate(float(np.median(every)), low, high)


class Pairing(NamedTuple):
    """Two drivers on the same episodes; ``p_value`` by McNemar's exact test, both sides."""

    only_first: int  # episodes that the first did and the second failed
    only_second: int
    p_value: float


def paired(first: Sequence[bool], second: Sequence[bool]) -> Pairing:
    """Compare two drivers by which episodes they did."""
    from scipy.stats import binomtest

    differ = [a for a, b in zip(first, second, strict=True) if a != b]
    if not differ:
        return Pairing(0, 0, 1.0)
    wins = sum(differ)
    return Pairing(wins, len(differ) - wins, float(binomtest(wins, len(differ)).pvalue))
