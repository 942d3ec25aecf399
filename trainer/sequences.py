"""Pictures of one drive look alike: what is held out of them is the end of the drive, together."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np


def ends(names: Sequence[str], share: float, fewest: int = 0) -> np.ndarray:
    """(N,) bool: the last ``share`` of every sequence, of ``fewest`` or more where it has as many.

    A sequence is what shares the name before the last underscore; names sort by time. Never more
    than half of a sequence is taken for ``fewest``.
    """
    chosen = np.zeros(len(names), bool)
    sequences: dict[str, list[int]] = {}
    for i, name in enumerate(names):
        sequences.setdefault(name.rpartition("_")[0], []).append(i)
    for members in sequences.values():
        members.sort(key=lambda i: names[i])
        count = max(round(share * len(members)), min(fewest, len(members) // 2))
        chosen[members[len(members) - count :]] = True
    return chosen
