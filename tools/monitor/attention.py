"""Where the policy looks, worked out on the monitor's computer from the pictures that come in.

The robot never computes it: its four cores have the camera, the motors and the next decision to do.
"""

import base64
import threading
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import cv2
import numpy as np

from robot.camera.source import fit_to_frame
from robot.inference.preprocess import preprocess
from robot.link.messages import FrameMessage, Telemetry
from robot.recording.drive_file import picture

if TYPE_CHECKING:
    from trainer.judging.explain import Explainer

GRID_ROWS, GRID_COLUMNS = 12, 16  # over the whole frame


@dataclass(frozen=True)
class Attention:
    """A coarse grid over the picture, one byte a cell in base64, rows from the top."""

    rows: int
    columns: int
    cells: str


@dataclass(frozen=True)
class Explained(Telemetry):
    """A robot's report, and where its policy looks."""

    attention: Attention | None = None


class AttentionThread:
    """Explains the newest picture when it has done with another; needs the extra ``trainer``."""

    def __init__(self, model: Path) -> None:
        from trainer.judging.explain import Explainer

        self._explainer = Explainer(model)
        self._working: threading.Thread | None = None
        self.newest: Attention | None = None  # of the last picture; None where it cannot be read

    def offer(self, frame: FrameMessage) -> None:
        """Explain this picture, unless another is being explained; returns at once."""
        if self._working is None or not self._working.is_alive():
            self._working = threading.Thread(target=self._explain, args=(frame,), daemon=True)
            self._working.start()

    def _explain(self, frame: FrameMessage) -> None:
        found = None
        with suppress(ValueError):  # of a JPEG that cannot be decoded
            found = attention_of(self._explainer, fit_to_frame(picture(frame.jpeg)))
        self.newest = found


def attention_of(explainer: "Explainer", frame: np.ndarray) -> Attention:
    """The grid over a frame (120, 160, 3) uint8 RGB."""
    weights = weights_over(explainer, frame)
    grid = cv2.resize(weights, (GRID_COLUMNS, GRID_ROWS), interpolation=cv2.INTER_AREA)
    cells = np.round(np.nan_to_num(grid / max(float(grid.max()), 1e-9)) * 255.0).astype(np.uint8)
    return Attention(GRID_ROWS, GRID_COLUMNS, base64.b64encode(cells.tobytes()).decode("ascii"))


def weights_over(explainer: "Explainer", frame: np.ndarray) -> np.ndarray:
    """Where the policy looks in a frame, in [0, 1]; 0 in the rows that it does not see."""
    spec = explainer.contract.image
    weights = np.zeros((spec.height_px, spec.width_px), np.float32)
    image = np.tile(preprocess(frame, spec), explainer.contract.frames)
    weights[spec.crop_top_px :] = explainer.attention(image[None])[0]
    return weights
