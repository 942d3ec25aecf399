"""This computer, as the checks see it. Looks only: nothing is written to any device."""

from __future__ import annotations

import glob
import platform
import re
import shutil
import socket
import sys
import time
from contextlib import suppress
from pathlib import Path
from typing import Dict, List, NamedTuple, Optional, Tuple

import numpy as np

from robot.config import CameraConfig
from robot.errors import HardwareError
from robot.hat.bus import I2cBus, SmbusBus
from robot.runtime.assemble import CAPTURE_PX, open_stream

CONNECT_S = 1.0


class CameraLook(NamedTuple):
    """What a camera gave in a while; ``problem`` is "" unless it ended early."""

    pictures: int = 0
    seconds: float = 0.0  # from the first picture to the last
    size_px: Tuple[int, int] = (0, 0)
    repeats: int = 0  # pictures with the bytes of the one before
    brightness: float = 0.0  # mean of the last, 0 to 255
    problem: str = ""

    @property
    def rate_hz(self) -> float:
        """Pictures a second."""
        return (self.pictures - 1) / self.seconds if self.seconds > 0.0 else 0.0


class Machine:
    """The computer that this program runs on, as the checks see it."""

    def python(self) -> Tuple[int, int]:
        """Version of the interpreter."""
        return sys.version_info[:2]

    def processor(self) -> str:
        """Such as ``aarch64``."""
        return platform.machine()

    def package(self, name: str) -> Optional[str]:
        """Version of an installed package; None without it."""
        from importlib import metadata

        try:
            return metadata.version(name)
        except metadata.PackageNotFoundError:
            return None

    def buses(self) -> List[int]:
        """Numbers of the I2C buses."""
        return sorted(int(path.rsplit("-", 1)[1]) for path in glob.glob("/dev/i2c-*"))

    def open_bus(self, number: int) -> I2cBus:
        """One of them; HardwareError when it cannot be used."""
        return SmbusBus(number)

    def watch(self, camera: CameraConfig, seconds: float) -> CameraLook:
        """Look through a camera that is no replay for a while."""
        look, last, began_s = CameraLook(), None, 0.0
        try:
            stream = open_stream(camera, CAPTURE_PX)
        except HardwareError as error:
            return look._replace(problem=str(error))
        try:
            while look.seconds < seconds:
                picture = stream.grab()
                began_s = began_s or time.monotonic()
                look = CameraLook(
                    look.pictures + 1,
                    time.monotonic() - began_s,
                    (picture.shape[1], picture.shape[0]),
                    look.repeats + (last is not None and np.array_equal(picture, last)),
                    float(picture.mean()),
                )
                last = picture
        except HardwareError as error:
            look = look._replace(problem=str(error))
        finally:
            stream.close()
        return look

    def free_bytes(self, path: Path) -> int:
        """Free space on the disk of ``path``."""
        return shutil.disk_usage(path).free

    def temperatures_c(self) -> Dict[str, float]:
        """By the name of the sensor; empty where there are none."""
        found: Dict[str, float] = {}
        for zone in Path("/sys/class/thermal").glob("thermal_zone*"):
            with suppress(OSError, ValueError):
                name = (zone / "type").read_text(encoding="ascii").strip()
                found[name] = int((zone / "temp").read_text(encoding="ascii")) / 1000.0
        return found

    def frequencies_khz(self) -> List[Tuple[int, int]]:
        """Highest frequency allowed and possible, for each core; empty where nobody knows."""
        found = []
        for folder in sorted(Path("/sys/devices/system/cpu").glob("cpu[0-9]*/cpufreq")):
            with suppress(OSError, ValueError):
                names = ("scaling_max_freq", "cpuinfo_max_freq")
                allowed, possible = (int((folder / n).read_text(encoding="ascii")) for n in names)
                found.append((allowed, possible))
        return found

    def wall_time_s(self) -> float:
        """Seconds since 1970."""
        return time.time()

    def time_is_synchronised(self) -> Optional[bool]:
        """Whether a time server was heard (systemd-timesyncd leaves a file); None where unknown."""
        folder = Path("/run/systemd/timesync")
        return (folder / "synchronized").exists() if folder.is_dir() else None

    def connects(self, host: str, port: int) -> str:
        """Why nobody answers there; "" when somebody does."""
        try:
            socket.create_connection((host, port), CONNECT_S).close()
        except OSError as error:
            return re.sub(r"^\[Errno -?\d+\] ", "", str(error))
        return ""

    def port_is_free(self, port: int) -> bool:
        """Whether a program can listen on it."""
        with socket.socket(socket.AF_INET, socket.SOCK_STREAM) as listener:
            listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            try:
                listener.bind(("", port))
            except OSError:
                return False
        return True
