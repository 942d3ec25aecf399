"""Painted lines by their brightness alone: a judge of translations that nothing was learned for.

On the floor that the simulator says is in sight there are two kinds of pixels, bright paint and
dark road. Otsu's threshold (1979) parts them in each picture, on red and green: blue is what casts
take away.
"""

from __future__ import annotations

import cv2
import numpy as np

_FLOOR_SHARE = 0.98  # of a pixel that must be white or yellow paint, or road
_LEAST_CONTRAST = 25.0  # grey levels between paint and road, below which nothing is a line


def bright_lines(pictures: np.ndarray, paint: np.ndarray) -> np.ndarray:
    """(N, H, W) uint8, 1 on lines.

    Args:
        pictures: (N, H, W, 3) uint8 RGB, as simulated or translated.
        paint: (N, 4, H, W) uint8, shares of white, yellow and red paint and of road: says only
            where to look.
    """
    masks = np.zeros(pictures.shape[:3], np.uint8)
    shares = paint.astype(np.float32) / 255.0
    floors = shares[:, 0] + shares[:, 1] + shares[:, 3] >= _FLOOR_SHARE
    brightness = pictures[..., :2].mean(-1)
    for mask, light, floor in zip(masks, brightness, floors, strict=True):
        seen = np.round(light[floor]).astype(np.uint8)
        if not len(seen):
            continue
        level, _ = cv2.threshold(seen, 0, 255, cv2.THRESH_BINARY + cv2.THRESH_OTSU)
        bright = seen > level
        both = bright.any() and not bright.all()
        if both and seen[bright].mean() - seen[~bright].mean() > _LEAST_CONTRAST:
            mask[floor] = light[floor] > level
    return masks
