"""A USB camera through OpenCV's V4L2."""

from __future__ import annotations

from typing import Any, Tuple

import numpy as np

from robot.errors import ContractError, HardwareError


class V4l2Stream:
    """``/dev/video<device>``. A read waits ten seconds at most (OpenCV's own limit).

    Raises:
        HardwareError: no such device, or it is in use, or may not be opened by this user.
    """

    def __init__(self, device: int, size_px: Tuple[int, int], fps: int) -> None:
        import cv2

        self._name = f"/dev/video{device}"
        self._odd = cv2.error
        self._capture: Any = cv2.VideoCapture(device, cv2.CAP_V4L2)
        if not self._capture.isOpened():
            raise HardwareError(
                f"{self._name}: expected a camera that opens; check its plug, that no other "
                "program uses it, and that this user is in the group video"
            )
        self._capture.set(cv2.CAP_PROP_FRAME_WIDTH, size_px[0])
        self._capture.set(cv2.CAP_PROP_FRAME_HEIGHT, size_px[1])
        self._capture.set(cv2.CAP_PROP_FPS, fps)
        self._capture.set(cv2.CAP_PROP_BUFFERSIZE, 1)

    def grab(self) -> np.ndarray:
        """The next picture (H, W, 3) uint8 RGB.

        Raises:
            HardwareError: none came.
            ContractError: one came that is not in colour, or that OpenCV cannot decode.
        """
        try:
            good, picture = self._capture.read()
        except self._odd as error:
            raise ContractError(f"{self._name}: expected a picture, got: {error}") from error
        if not good or picture is None:
            raise HardwareError(f"{self._name}: expected a picture, got none; was it unplugged?")
        if picture.ndim != 3:
            raise ContractError(f"{self._name}: expected colours, got {picture.shape}")
        return np.ascontiguousarray(picture[..., ::-1])

    def close(self) -> None:
        """Let the device go."""
        self._capture.release()
