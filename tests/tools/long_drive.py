"""``python -m tests.tools.long_drive MODEL HOURS [EVERY_S]``: hours in minutes, for leaks.

The robot as `robot.runtime.assemble` puts it together, with its links, on a camera and motors that
are made up; time is simulated and as fast as this computer. A second pair of links in the same
process plays localizer and monitor, and is closed and opened again now and then. Writes a JSON
line of figures for every ``EVERY_S``. Python 3.8.
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
from typing import TYPE_CHECKING, Any

from robot.command_line import answer

if TYPE_CHECKING:
    from tests.tools.long_drive_parts import Others

EVERY_S = 600.0  # simulated
RECONNECT_SHARE = 0.45  # of that: between two looks the others are started again
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


def drive(
    model: Path, hours: float, tell: Callable[[dict[str, float]], None], every_s: float = EVERY_S
) -> None:
    """Drive missions for some simulated hours; ``tell`` is called with the figures so far."""
    clock = FastClock()
    clocks: Any = time
    clocks.monotonic, clocks.sleep = clock.now, clock.sleep  # before the robot is imported
    from robot.config import RobotConfig
    from robot.contract import CONTROL_DT_S
    from robot.link.keys import keygen
    from robot.link.sockets import LinkConfig
    from robot.runtime import timing
    from robot.runtime.assemble import open_robot
    from robot.runtime.timing import RateKeeper
    from tests.robot.link.conftest import free_base_port
    from tests.tools.long_drive_parts import MadeUpCamera, MadeUpMotors, Others, start_of

    timing.SILENCE_S = math.inf  # its thread lives in real time, which hardly passes here
    with tempfile.TemporaryDirectory() as folder:
        keys = keygen(Path(folder) / "keys")
        port = free_base_port()
        links = {name: LinkConfig(str(path), base_port=port) for name, path in keys.items()}
        motors = MadeUpMotors(start_of("arena"), clock.now)
        others = Others(links["localizer"], links["monitor"], motors, clock.now)
        config = RobotConfig(str(model), map="arena", link=links["robot"])
        camera = MadeUpCamera(clock.now, PICTURES)
        rate = RateKeeper(CONTROL_DT_S, clock)
        begun_s = told_s = reconnected_s = clock.now()
        with open_robot(
            config,
            subscribers=(others,),
            camera=nullcontext(camera),
            motors=nullcontext(motors),
        ) as runtime:
            while clock.now() - begun_s < 3600.0 * hours:
                runtime.step(rate.wait())
                if clock.now() - reconnected_s > RECONNECT_SHARE * every_s:
                    reconnected_s = clock.now()
                    others.reconnect()
                if clock.now() - told_s >= every_s:
                    told_s = clock.now()
                    tell(figures((told_s - begun_s) / 3600.0, others))
        others.close()


def figures(hours: float, others: Others) -> dict[str, float]:
    """Of this process, now."""
    status = Path("/proc/self/status").read_text(encoding="ascii")
    resident = next(line for line in status.splitlines() if line.startswith("VmRSS:"))
    return {
        "hours": hours,
        "rss_mb": int(resident.split()[1]) / 1024.0,
        "fds": len(os.listdir("/proc/self/fd")),
        "threads": len(os.listdir("/proc/self/task")),
        "python_threads": threading.active_count(),
        "missions": others.missions,
        "stops": others.stops,
        "carried": others.carried,
    }


def main(arguments: list | None = None) -> int:
    """Exit status 0; 2 for wrong arguments."""
    words = sys.argv[1:] if arguments is None else arguments
    try:
        model, hours = Path(words[0]), float(words[1])
        every_s = float(words[2]) if len(words) > 2 else EVERY_S
        if not (0.0 < hours < math.inf and 0.0 < every_s < math.inf):
            raise ValueError(words)
    except (IndexError, ValueError):
        print("long_drive: expected MODEL HOURS [EVERY_S], positive numbers", file=sys.stderr)
        return 2

    def work() -> None:
        drive(model, hours, lambda row: print(json.dumps(row), flush=True), every_s)

    return answer("long_drive", work)


if __name__ == "__main__":
    sys.exit(main())
