"""A thread that keeps the newest picture of a stream, and opens the stream again when it ends."""

from __future__ import annotations

import logging
from typing import Callable, Optional, Protocol

import numpy as np

from robot.camera.source import Frame, fit_to_frame
from robot.errors import ContractError
from robot.worker import Worker

FIRST_WAIT_S = 0.5  # before opening again; doubles up to
LONGEST_WAIT_S = 8.0
ODD_WAIT_S = 0.01  # a stream of odd pictures must not keep a processor busy
JOIN_S = 3.0

logger = logging.getLogger(__name__)


class Stream(Protocol):
    """An open camera."""

    def grab(self) -> np.ndarray:
        """The next picture (H, W, 3) uint8 RGB, waiting for it a second or so at most.

        Raises:
            HardwareError: none came.
            ContractError: an odd one came, and the next may well be good.
        """

    def close(self) -> None:
        """Let the device go, also after an error."""


class NewestFrame(Worker):
    """A ``Camera`` in a ``with`` block, over a stream that may end at any time.

    An odd picture counts as none. A stream that ends is opened again with a growing wait, also when
    the computer has no descriptor left for it; meanwhile ``read`` gives the last frame, whose age
    stops the robot. ``problem`` says what is wrong, "" while pictures come.

    Args:
        open_stream: opens the device; raises HardwareError.
        clock: monotonic time [s].
        first_wait_s: before the first new attempt [s].
    """

    def __init__(
        self,
        open_stream: Callable[[], Stream],
        clock: Callable[[], float],
        first_wait_s: float = FIRST_WAIT_S,
    ) -> None:
        super().__init__("camera", JOIN_S)
        self.problem = "the camera has not started"
        self.restarts = 0
        self._open_stream = open_stream
        self._clock = clock
        self._first_wait_s = first_wait_s
        self._frame: Optional[Frame] = None

    def read(self) -> Optional[Frame]:
        """The newest frame, at once; None before the first.

        Raises:
            HardwareError: the thread itself has died.
        """
        self.check()
        return self._frame

    def _work(self) -> None:
        wait_s = self._first_wait_s
        while not self._ending.is_set():
            before = self._frame
            try:
                self._play()
            except (RuntimeError, OSError, ValueError, MemoryError) as error:
                self._complain(error)
            if self._frame is not before:
                wait_s = self._first_wait_s
            self._ending.wait(wait_s)
            wait_s = min(2.0 * wait_s, LONGEST_WAIT_S)
            self.restarts += not self._ending.is_set()

    def _play(self) -> None:
        stream = self._open_stream()
        try:
            while not self._ending.is_set():
                try:
                    image = _frame_of(stream.grab())
                except ContractError as error:
                    self._complain(error)
                    self._ending.wait(ODD_WAIT_S)
                    continue
                sequence = self._frame.sequence + 1 if self._frame else 0
                # One assignment: the other thread sees the old frame or the new one.
                self._frame = Frame(image, sequence, self._clock())
                self.problem = ""
        finally:
            stream.close()

    def _complain(self, error: Exception) -> None:
        told = str(error) or type(error).__name__
        if told != self.problem:
            logger.warning("camera: %s", told)
        self.problem = told


def _frame_of(picture: np.ndarray) -> np.ndarray:
    """The picture as a frame; ContractError of whatever cannot be one."""
    try:
        return fit_to_frame(picture)
    except Exception as error:  # from NumPy, from OpenCV, or the lack of a shape at all
        raise ContractError(f"odd picture: {error or type(error).__name__}") from error
