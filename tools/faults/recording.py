"""The disk takes no more while a drive is recorded."""

from __future__ import annotations

import resource

from tools.faults.case import Case
from tools.faults.stage import Stage

UNLIMITED = (resource.RLIM_INFINITY, resource.RLIM_INFINITY)


def _largest(stage: Stage) -> int:
    """The recording being written [bytes]."""
    files = [path for path in stage.bench.recordings.rglob("*") if path.is_file()]
    return max((path.stat().st_size for path in files), default=0)


def _full(stage: Stage) -> None:
    pid = stage.bench.processes["robot"].child.pid
    limit = max(_largest(stage), 4096)
    resource.prlimit(pid, resource.RLIMIT_FSIZE, (limit, resource.RLIM_INFINITY))


def _room(stage: Stage) -> None:
    pid = stage.bench.processes["robot"].child.pid
    resource.prlimit(pid, resource.RLIMIT_FSIZE, UNLIMITED)


def _told(stage: Stage) -> str:
    readings = stage.bench.operator.robot.get("health", ())
    told = [reading for reading in readings if "record" in reading["name"]]
    if not told or told[0]["level"] == "ok":
        return f"the page does not say that nothing is recorded: {told}"
    return ""


CASES = (
    Case(
        *("disk full", "no file may grow any more", _full),
        threshold_s=1.5,  # what is recorded reaches the disk once a second
        states=(),
        heal=_room,
        check=_told,
    ),
)
