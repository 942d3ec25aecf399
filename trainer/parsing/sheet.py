"""Pictures for a person: frames, what a parser saw in them, and the truth."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np

from trainer.parsing.labelled import Labelled
from trainer.parsing.train import Parser
from trainer.run import atomically

ROWS = 6


def draw_sheet(parser: Parser, data: Labelled, path: Path) -> None:
    """Write rows of frame, labels found, true labels: `ROWS` frames spread over the data."""
    chosen = data.pick(np.linspace(0, len(data) - 1, min(ROWS, len(data))).astype(int))
    columns = (
        chosen.frames,
        data.labels.paint(parser(chosen.frames)),
        data.labels.paint(chosen.truth),
    )
    write_png(path, np.vstack([np.hstack(row) for row in zip(*columns, strict=True)]))


def write_png(path: Path, picture: np.ndarray) -> None:
    """Write an (H, W, 3) uint8 RGB picture, whole or not at all."""
    _, data = cv2.imencode(".png", picture[..., ::-1], (cv2.IMWRITE_PNG_COMPRESSION, 9))
    with atomically(path) as temporary:
        temporary.write_bytes(np.asarray(data).tobytes())
