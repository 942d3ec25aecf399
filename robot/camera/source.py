"""What a camera is to the runtime: somebody who has the newest frame."""

from __future__ import annotations

from typing import NamedTuple, Optional, Protocol

import numpy as np

from robot.contract import FRAME_HEIGHT_PX, FRAME_WIDTH_PX
from robot.errors import ContractError


class Frame(NamedTuple):
    """A picture (120, 160, 3) uint8 RGB, its number, and when it was taken by the robot's clock.

    Numbers grow by one or more; the same number is the same frame.
    """

    image: np.ndarray
    sequence: int
    time_s: float


class Camera(Protocol):
    """Gives the newest frame, at once."""

    def read(self) -> Optional[Frame]:
        """The newest frame; the same one again until a newer has come, None before the first.

        Raises:
            HardwareError: the camera has failed for good.
        """


def fit_to_frame(picture: np.ndarray) -> np.ndarray:
    """Any picture (H, W, 3) uint8 RGB as a frame (120, 160, 3): its middle 4:3, resized by area.

    Raises:
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
