"""The robot's camera, looking into the simulated world."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from robot.camera.source import Frame
from robot.hat.clock import Clock


class VirtualCamera:
    """A camera (``robot.camera.source.Camera``) that takes a new frame at every moment it is read.

    Args:
        see: the picture (120, 160, 3) uint8 RGB of this moment, as ``VirtualWorld.see``.
        clock: the robot's.
    """

    def __init__(self, see: Callable[[], np.ndarray], clock: Clock) -> None:
        self._see = see
        self._clock = clock
        self._frame: Frame | None = None

    def read(self) -> Frame:
        """The frame of now; the same one again within the same instant."""
        now_s = self._clock.now()
        if self._frame is None or self._frame.time_s != now_s:
            sequence = 0 if self._frame is None else self._frame.sequence + 1
            self._frame = Frame(self._see(), sequence, now_s)
        return self._frame
