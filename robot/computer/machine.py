"""This computer, as the checks see it. Looks only: nothing is written to any device."""

import glob
import platform
import socket
import sys
import time
from contextlib import closing, suppress
from importlib import metadata
from typing import List, NamedTuple, Optional, Tuple

import numpy as np

from robot.camera.source import CAPTURE_PX, open_stream
from robot.computer.health import readings
from robot.config import CameraConfig
from robot.hat.bus import SmbusBus

CONNECT_S = 1.0


class CameraLook(NamedTuple):
    """What a camera gave in a while."""

    rate_hz: float  # pictures a second
    size_px: Tuple[int, int]
    frozen: bool  # each picture has the bytes of the one before
    brightness: float  # mean of the last, 0 to 255


class Machine:
    """The computer that this program runs on, as the checks see it."""

    python = sys.version_info[:2]
    processor = platform.machine()  # such as ``aarch64``
    open_bus = staticmethod(SmbusBus)  # by its number; HardwareError when it cannot be used
    readings = staticmethod(readings)  # of its health

    def package(self, name: str) -> Optional[str]:
        """Version of an installed package; None without it."""
        with suppress(metadata.PackageNotFoundError):
            return metadata.version(name)
        return None

    def buses(self) -> List[int]:
        """Numbers of the I2C buses."""
        return sorted(int(path.rsplit("-", 1)[1]) for path in glob.glob("/dev/i2c-*"))

    def watch(self, camera: CameraConfig, seconds: float) -> CameraLook:
        """Look through a camera for a while; HardwareError when it ends before."""
        with closing(open_stream(camera, CAPTURE_PX)) as stream:
            picture, count, frozen = stream.grab(), 0, True
            began_s = now_s = time.monotonic()
            while now_s < began_s + seconds:
                last, picture = picture, stream.grab()
                now_s, count = time.monotonic(), count + 1
                frozen = frozen and np.array_equal(picture, last)
        size = (picture.shape[1], picture.shape[0])
        return CameraLook(count / (now_s - began_s), size, frozen, float(picture.mean()))

    def connects(self, host: str, port: int) -> str:
        """Why nobody answers there; "" when somebody does."""
        try:
            socket.create_connection((host, port), CONNECT_S).close()
        except OSError as error:
            return error.strerror or str(error)
        return ""
