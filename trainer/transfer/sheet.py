"""Pictures for a person: columns of pictures that belong together, row by row."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import cv2
import numpy as np

from robot.output import write_png

ROWS = 6  # of a usual sheet
_ENLARGED = 2
_GAP = 4


def draw_sheet(path: Path, columns: Mapping[str, np.ndarray]) -> None:
    """Write a PNG file of titled columns, each pictures (N, H, W, 3) uint8 RGB of one size."""
    write_png(path, np.hstack([_column(name, shown) for name, shown in columns.items()]))


def _column(name: str, pictures: np.ndarray) -> np.ndarray:
    title = np.full((16, pictures.shape[2] * _ENLARGED + _GAP, 3), 255, np.uint8)
    cv2.putText(title, name, (2, 12), cv2.FONT_HERSHEY_SIMPLEX, 0.4, (0, 0, 0), 1, cv2.LINE_AA)
    large = pictures.repeat(_ENLARGED, 1).repeat(_ENLARGED, 2)
    around = ((0, 0), (0, _GAP), (0, _GAP), (0, 0))
    rows = np.pad(large, around, constant_values=255)
    return np.vstack([title, *rows])
