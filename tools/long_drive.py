"""``python -m tools.long_drive MODEL HOURS``: hours of driving in minutes, watched for leaks.

The robot as `robot.assemble` puts it together, with its links, on a camera and motors that are made
up; time is simulated and as fast as this computer. A second pair of links in the same process plays
localizer and monitor, and is closed and opened again now and then. Writes a JSON line of figures
for every ``EVERY_S``. Python 3.8, and nothing but the robot's own packages: it runs on the robot.
"""

from __future__ import annotations

import json
import math
import os
import sys
import tempfile
import threading
import time
from collections.abc import Callable
from contextlib import nullcontext
from pathlib import Path
from typing import Any

EVERY_S = 600.0  # simulated
RECONNECT_S = 590.0
PICTURES = 16


class FastClock:
    """Time that goes on when somebody waits for it."""

    def __init__(self) -> None:
        self.now_s = 1000.0

    def now(self) -> float:
        """[s]"""
        return self.now_s

    def sleep(self, duration_s: float) -> None:
        """Go on by ``duration_s`` [s]."""
        self.now_s += max(duration_s, 0.0)


def drive(model: Path, hours: float, tell: Callable[[dict[str, float]], None]) -> None:
    """Drive missions for some simulated hours; ``tell`` is called with the figures so far."""
    clock = FastClock()
    clocks: Any = time
    clocks.monotonic, clocks.sleep = clock.now, clock.sleep  # before the robot is imported
    from robot.assemble import open_robot
    from robot.config import RobotConfig
    from robot.link.config import LinkConfig
    from robot.link.keys import keygen
    from tools.long_drive_parts import MadeUpCamera, MadeUpMotors, Others, start_of

    with tempfile.TemporaryDirectory() as folder:
        keys = keygen(Path(folder) / "keys")
        links = {name: LinkConfig(str(path), base_port=_ports()) for name, path in keys.items()}
        port = links["robot"].base_port
        links = {name: LinkConfig(c.keys, base_port=port) for name, c in links.items()}
        motors = MadeUpMotors(start_of("arena"), clock.now)
        others = Others(links["localizer"], links["monitor"], motors, clock.now)
        config = RobotConfig(str(model), map="arena", link=links["robot"])
        camera = MadeUpCamera(clock.now, PICTURES)
        begun_s = told_s = reconnected_s = clock.now()
        with open_robot(
            config,
            subscribers=(others,),
            camera=nullcontext(camera),
            motors=nullcontext(motors),
        ) as runtime:
            while clock.now() - begun_s < 3600.0 * hours:
                runtime.run(turns=50)
                if clock.now() - reconnected_s > RECONNECT_S:
                    reconnected_s = clock.now()
                    others.reconnect()
                if clock.now() - told_s >= EVERY_S:
                    told_s = clock.now()
                    tell(figures((told_s - begun_s) / 3600.0, others.missions, others.stops))
        others.close()


def figures(hours: float, missions: int, stops: int) -> dict[str, float]:
    """Of this process, now."""
    status = Path("/proc/self/status").read_text(encoding="ascii")
    resident = next(line for line in status.splitlines() if line.startswith("VmRSS:"))
    return {
        "hours": hours,
        "rss_mb": int(resident.split()[1]) / 1024.0,
        "fds": len(os.listdir("/proc/self/fd")),
        "threads": len(os.listdir("/proc/self/task")),
        "python_threads": threading.active_count(),
        "missions": missions,
        "stops": stops,
    }


def _ports() -> int:
    """Four free ports in a row, most likely."""
    import socket

    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return min(int(probe.getsockname()[1]), 65000)


def main(arguments: list | None = None) -> int:
    """Exit status 0; 2 for wrong arguments."""
    words = sys.argv[1:] if arguments is None else arguments
    try:
        model, hours = Path(words[0]), float(words[1])
        if not 0.0 < hours < math.inf:
            raise ValueError(hours)
    except (IndexError, ValueError):
        print("long_drive: expected MODEL and a positive number of HOURS", file=sys.stderr)
        return 2
    drive(model, hours, lambda row: print(json.dumps(row), flush=True))
    return 0


if __name__ == "__main__":
    sys.exit(main())
