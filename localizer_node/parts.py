"""Blobs as they lie on the floor, and how well they fit the parts of a board."""

from __future__ import annotations

import math
from typing import NamedTuple, Sequence, Tuple

import numpy as np

from localizer_node.colour import Blob

SIZE_TOLERANCE = 0.4  # relative, of each side
FILL_RANGE = (0.75, 1.25)  # area over that of the rectangle with the same second moments


class Part(NamedTuple):
    """A blob as it lies at the height of the boards."""

    centre_m: np.ndarray  # (2,)
    sides_m: Tuple[float, float]  # of the rectangle with the same second moments, longer first
    fill: float  # area over that rectangle's: 1 for a rectangle, 1.05 for a disc, less for an L
    centre_px: Tuple[float, float]


def measured(blob: Blob, centre_m: np.ndarray, jacobian: np.ndarray, centre_px: np.ndarray) -> Part:
    """A blob on the floor, by the derivative (2, 2) [m/px] of pixel to floor at its centre."""
    uu, uv, vv = blob.covariance_px2
    pixel = 1.0 / 12.0  # the variance of a pixel's own width
    covariance = jacobian @ np.array([[uu + pixel, uv], [uv, vv + pixel]]) @ jacobian.T
    values = np.linalg.eigvalsh(covariance)
    short, long = (math.sqrt(12.0 * max(float(v), 1e-12)) for v in values)
    area = blob.area_px * abs(float(np.linalg.det(jacobian)))
    place = (float(centre_px[0]), float(centre_px[1]))
    return Part(centre_m, (long, short), area / (long * short), place)


def bell(error: float, width: float) -> float:
    """1 at no error, 0.6 at ``width``."""
    return math.exp(-0.5 * (error / width) ** 2)


def size_fit(part: Part, expected_m: Sequence[float]) -> float:
    """How well a part has these sides [m] and is a filled rectangle: 1 exactly, 0 beyond doubt."""
    errors = [a / b - 1.0 for a, b in zip(part.sides_m, sorted(expected_m, reverse=True))]
    if max(abs(e) for e in errors) > SIZE_TOLERANCE:
        return 0.0
    if not FILL_RANGE[0] <= part.fill <= FILL_RANGE[1]:
        return 0.0
    return bell(math.hypot(*errors), SIZE_TOLERANCE / 2.0)
