"""Where in the picture a board may be, from the blue of every n-th pixel."""

from __future__ import annotations

from typing import Iterable, List, Tuple

import numpy as np

from localizer_node.calibration import Calibration
from localizer_node.colour import coarse_rects, mask_of, opened, to_hsv
from localizer_node.parts import merged
from localizer_node.rectify import Rect
from robot.lens import Lens

COARSE_SIDE_PX = 8  # what the shorter side of a board keeps in the coarse mask
NARROW = 0.5  # of a board's shorter side: blue narrower than this may be cut off


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
        result: List[Rect] = []
        for a, b, c, d in coarse_rects(mask, least_px):
            if max(c - a, d - b) <= most_px:
                result.append((a, b, c, d))
                continue
            core = opened(mask[b:d, a:c], self.narrow_px(step))
            for e, f, g, h in coarse_rects(core, least_px):
                if max(g - e, h - f) <= most_px:
                    result.append((a + e, b + f, a + g, b + h))
        return result

    def narrow_px(self, step: int) -> int:
        """Width of what is cut off, in pixels of every ``step``-th pixel's mask."""
        return max(int(NARROW * self._shorter_m() * self._scales[0] / step), 1)

    def _shorter_m(self) -> float:
        return min(side for m in self._markers for side in m.blue_m)


def clipped(lens: Lens, rect: Rect) -> Rect:
    """The part of a slice that lies in the picture."""
    u0, v0 = max(rect[0], 0), max(rect[1], 0)
    return (u0, v0, max(min(rect[2], lens.width_px), u0), max(min(rect[3], lens.height_px), v0))
