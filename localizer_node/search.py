"""Where in the picture a board may be, and how well what is there fits the parts of one.

The blue of every n-th pixel tells where to look; blobs are measured on the floor.
"""

from __future__ import annotations

import math
from typing import Iterable, List, NamedTuple, Sequence, Tuple

import numpy as np

from localizer_node.calibration import Calibration
from localizer_node.colour import Blob, coarse_rects, mask_of, to_hsv
from localizer_node.rectify import Rect
from robot.lens import Lens

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


def merged(rects: Sequence[Rect]) -> List[Rect]:
    """The same area as fewer rectangles: those that overlap become one."""
    result: List[Rect] = []
    for rect in rects:
        a, b, c, d = rect
        again = True
        while again:
            again = False
            for other in result:
                if a < other[2] and other[0] < c and b < other[3] and other[1] < d:
                    result.remove(other)
                    a, b = min(a, other[0]), min(b, other[1])
                    c, d = max(c, other[2]), max(d, other[3])
                    again = True
                    break
        result.append((a, b, c, d))
    return result


COARSE_SIDE_PX = 8  # what the shorter side of a board keeps in the coarse mask


class CoarseSearch:
    """Finds windows worth a closer look; ``scales`` are least and greatest px per metre."""

    def __init__(self, calibration: Calibration, scales: Tuple[float, float]) -> None:
        self._lens = calibration.lens
        self._markers = calibration.robots
        self._blue = calibration.colour(calibration.board_colour)
        self._scales = scales

    def windows(self, image: np.ndarray, areas: Iterable[Rect]) -> List[Rect]:
        """Where blue of about the right size is, with room for the rest of the board."""
        if not self._markers:
            return []
        step = int(np.clip(self._shorter_m() * self._scales[0] / COARSE_SIDE_PX, 1, 4))
        room = int(max(m.board.length_m for m in self._markers) * self._scales[1] * 0.7) + 2
        rects: List[Rect] = []
        for u0, v0, u1, v1 in areas:
            mask = mask_of(to_hsv(image[v0:v1:step, u0:u1:step]), self._blue)
            for a, b, c, d in self._coarse(mask, step):
                rect = (u0 + a * step, v0 + b * step, u0 + c * step, v0 + d * step)
                rects.append((rect[0] - room, rect[1] - room, rect[2] + room, rect[3] + room))
        return [clipped(self._lens, rect) for rect in merged(rects)]

    def _coarse(self, mask: np.ndarray, step: int) -> List[Rect]:
        """Boxes of what may be a board, in a mask of every ``step``-th pixel."""
        least = 0.3 * min(m.blue_m[0] * m.blue_m[1] for m in self._markers)
        least_px = least * self._scales[0] ** 2 / step**2
        most_px = 2.5 * max(s for m in self._markers for s in m.blue_m) * self._scales[1] / step
        boxes = coarse_rects(mask, least_px)
        return [(a, b, c, d) for a, b, c, d in boxes if max(c - a, d - b) <= most_px]

    def _shorter_m(self) -> float:
        return min(side for m in self._markers for side in m.blue_m)


def clipped(lens: Lens, rect: Rect) -> Rect:
    """The part of a slice that lies in the picture."""
    u0, v0 = max(rect[0], 0), max(rect[1], 0)
    return (u0, v0, max(min(rect[2], lens.width_px), u0), max(min(rect[3], lens.height_px), v0))
