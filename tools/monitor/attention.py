"""Where the policy looks, worked out on the monitor's computer from the pictures that come in.

The robot never computes it: its four cores have the camera, the motors and the next decision to do.
"""

from __future__ import annotations

import threading
from pathlib import Path
from typing import TYPE_CHECKING

import cv2
import numpy as np

from robot.camera.source import fit_to_frame
from robot.computer.threads import Worker
from robot.errors import ConfigError
from robot.inference.preprocess import preprocess
from robot.link.messages import FrameMessage
from robot.link.telemetry import Attention
from robot.recording.drive_file import picture

if TYPE_CHECKING:
    from trainer.judging.explain import Explainer

GRID_ROWS, GRID_COLUMNS = 12, 16  # over the whole frame


class AttentionThread(Worker):
    """Explains the newest picture, one at a time; ``end`` it.

    ConfigError: the extra ``trainer`` is not installed. ContractError: the model is no policy of
    ours.
    """

    def __init__(self, model: Path) -> None:
        try:
            from trainer.judging.explain import Explainer
        except ImportError as error:
            raise ConfigError(
                "--model: expected the extra 'trainer' for the attention overlay, it is not "
                "installed; pip install 'duckpilot[trainer]', or leave --model out"
            ) from error
        super().__init__("attention")
        self._newest: Attention | None = None
        self._explainer = Explainer(model)
        self._changed = threading.Condition()
        self._waiting: FrameMessage | None = None
        self.start()

    @property
    def newest(self) -> Attention | None:
        """Of the newest picture; None before, for one that cannot be read, and without a thread."""
        return self._newest if self.alive else None

    def offer(self, frame: FrameMessage) -> None:
        """Explain this picture next, instead of one that still waits; returns at once."""
        with self._changed:
            self._waiting = frame
            self._changed.notify()

    def _wake(self) -> None:
        with self._changed:
            self._changed.notify()

    def _work(self) -> None:
        while True:
            with self._changed:
                self._changed.wait_for(lambda: self._waiting is not None or self._ending.is_set())
                frame, self._waiting = self._waiting, None
                if self._ending.is_set() or frame is None:
                    return
            try:
                self._newest = attention_of(self._explainer, fit_to_frame(picture(frame.jpeg)))
            except ValueError:  # a JPEG that cannot be decoded
                self._newest = None


def attention_of(explainer: Explainer, frame: np.ndarray) -> Attention:
    """The grid over a frame (120, 160, 3) uint8 RGB, 0 in the rows that the policy does not see."""
    spec = explainer.contract.image
    weights = np.zeros((spec.height_px, spec.width_px), np.float32)
    weights[spec.crop_top_px :] = explainer.attention(preprocess(frame, spec)[None])[0]
    grid = cv2.resize(weights, (GRID_COLUMNS, GRID_ROWS), interpolation=cv2.INTER_AREA)
    peak = float(grid.max())
    return Attention.from_array(grid / peak if peak > 0.0 else grid)
