"""What a camera is to the runtime: somebody who has the newest frame, whatever it comes from."""

from __future__ import annotations

import logging
from contextlib import closing
from typing import Callable, NamedTuple, Optional, Protocol

import numpy as np

from robot.computer.threads import Worker
from robot.contract import FRAME_HEIGHT_PX, FRAME_WIDTH_PX
from robot.errors import ContractError


class Frame(NamedTuple):
    """A picture (H, W, 3) uint8 RGB, its number, and when it was taken by a monotonic clock.

    Numbers grow by one or more; the same number is the same frame. A robot's is (120, 160, 3).
    """

    image: np.ndarray
    sequence: int
    time_s: float


class Camera(Protocol):
    """Gives the newest frame, at once."""

    def read(self) -> Optional[Frame]:
        """The newest frame; the same one again until a newer has come, None before the first.

        HardwareError: the camera has failed for good.
        """


def fit_to_frame(picture: np.ndarray) -> np.ndarray:
    """Any picture (H, W, 3) uint8 RGB as a frame (120, 160, 3): its middle 4:3, resized by area.

    ContractError: it is no RGB picture.
    """
    import cv2

    if picture.ndim != 3 or picture.shape[2] != 3 or picture.dtype != np.uint8:
        raise ContractError(
            f"picture: expected (H, W, 3) uint8 RGB, got {picture.shape} {picture.dtype}"
        )
    height, width = picture.shape[:2]
    wide = min(width, max(1, round(height * FRAME_WIDTH_PX / FRAME_HEIGHT_PX)))
    high = min(height, max(1, round(width * FRAME_HEIGHT_PX / FRAME_WIDTH_PX)))
    top, left = (height - high) // 2, (width - wide) // 2
    middle = picture[top : top + high, left : left + wide]
    size = (FRAME_WIDTH_PX, FRAME_HEIGHT_PX)
    return cv2.resize(middle, size, interpolation=cv2.INTER_AREA)


FIRST_WAIT_S = 0.5  # before opening again; doubles up to
LONGEST_WAIT_S = 8.0
ODD_WAIT_S = 0.01  # a stream of odd pictures must not keep a processor busy
JOIN_S = 3.0

logger = logging.getLogger(__name__)


class Stream(Protocol):
    """An open camera."""

    def grab(self) -> np.ndarray:
        """The next picture (H, W, 3) uint8 RGB, waiting for it a second or so at most.

        HardwareError: none came. ContractError: an odd one came, and the next may well be good.
        """

    def close(self) -> None:
        """Let the device go, also after an error."""


class NewestFrame(Worker):
    """A ``Camera`` in a ``with`` block, over a stream that may end at any time.

    An odd picture counts as none. A stream that ends is opened again with a growing wait, also when
    the computer has no descriptor left for it; meanwhile ``read`` gives the last frame, whose age
    stops the robot. ``problem`` says what is wrong, "" while pictures come.

    ``open_stream`` raises HardwareError; ``clock`` is monotonic [s].
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
        with closing(self._open_stream()) as stream:
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
