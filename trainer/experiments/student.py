"""How far the mean of a few seeds may be off."""

from __future__ import annotations

import numpy as np


def half_interval(values: np.ndarray) -> np.ndarray:
    """Half of Student's 95 % interval of the mean over the first axis; NaN of one value."""
    from scipy.stats import t

    count = len(values)
    if count < 2:
        return np.full(values.shape[1:], np.nan)
    return np.asarray(t.ppf(0.975, count - 1) * values.std(axis=0, ddof=1) / np.sqrt(count))
