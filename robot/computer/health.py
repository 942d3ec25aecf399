"""How the robot's computer is: temperature, disk, memory, load; each judged ok, warn or bad."""

import os
import shutil
from contextlib import suppress
from pathlib import Path
from typing import Callable, Dict, Iterator, Optional, Sequence, Tuple

from robot.link.messages import Reading

EVERY_S = 1.0
WARM_C, HOT_C = 80.0, 95.0  # a Jetson Nano slows down at 97 °C, a Raspberry Pi at 80
NO_THERMOMETER = "PMIC-Die"  # of a Nano always reads 100
LOW_DISK_PERCENT = 5.0
LEAST_DISK_MB = 200.0  # that a system needs
LOW_MEMORY_MB = 200.0


class Health:
    """Reads at most once a second by a monotonic clock [s]; ``others`` are read beside."""

    def __init__(self, clock: Callable[[], float], others: Sequence[Callable[[], Reading]]) -> None:
        self._clock, self._others = clock, others
        self._read_s: Optional[float] = None
        self._readings: Tuple[Reading, ...] = ()

    def readings(self) -> Tuple[Reading, ...]:
        """The newest."""
        now_s = self._clock()
        if self._read_s is None or now_s - self._read_s >= EVERY_S:
            self._read_s = now_s
            self._readings = (*readings(), *(read() for read in self._others))
        return self._readings


def readings(folder: Path = Path("/"), least_mb: float = LEAST_DISK_MB) -> Iterator[Reading]:
    """Of this computer, now, and of a folder's disk, to keep so much free; it may not exist yet."""
    hottest_c = max(temperatures_c().values(), default=None)
    if hottest_c is not None:
        level = "bad" if hottest_c >= HOT_C else "warn" if hottest_c >= WARM_C else "ok"
        yield Reading("temperature", round(hottest_c, 1), "°C", level)
    place = folder.resolve()
    disk = shutil.disk_usage(next(each for each in (place, *place.parents) if each.exists()))
    free_percent = 100.0 * disk.free / disk.total
    level = "ok" if free_percent > LOW_DISK_PERCENT else "warn"
    level = "bad" if disk.free < 1e6 * least_mb else level
    yield Reading("disk free", round(free_percent), "%", level)
    free_mb = memory_free_mb()
    if free_mb is not None:
        level = "ok" if free_mb > LOW_MEMORY_MB else "warn"
        yield Reading("memory free", round(free_mb), "MB", level)
    yield Reading("load", round(os.getloadavg()[0], 2))


def temperatures_c(zones: Path = Path("/sys/class/thermal")) -> Dict[str, float]:
    """Of every thermal zone that answers, by its sensor [°C]."""
    found: Dict[str, float] = {}
    for zone in zones.glob("thermal_zone*"):
        with suppress(OSError, ValueError):  # a zone that is switched off
            name = (zone / "type").read_text(encoding="ascii").strip()
            found[name] = int((zone / "temp").read_text(encoding="ascii")) / 1000.0
    return {n: c for n, c in found.items() if -40.0 < c < 200.0 and n != NO_THERMOMETER}


def memory_free_mb(source: Path = Path("/proc/meminfo")) -> Optional[float]:
    """Memory that programs can still have [MB]; None where Linux does not tell."""
    with suppress(OSError, ValueError):  # ValueError: not in the list
        words = source.read_text(encoding="ascii").split()
        return int(words[words.index("MemAvailable:") + 1]) / 1024.0
    return None
