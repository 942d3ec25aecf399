"""The disk takes no more while a drive is recorded."""

from __future__ import annotations

import resource

from robot.recording.drive_file import UNFINISHED
from tools.faults.case import Case
from tools.faults.stage import Stage
from tools.loop.timekeeper import BenchError

UNLIMITED = (resource.RLIM_INFINITY, resource.RLIM_INFINITY)


def _full(stage: Stage) -> None:
    """The recording that is being written may grow no more, nor may what is smaller."""
    pid = stage.bench.processes["robot"].child.pid
    written = [path.stat().st_size for path in stage.bench.recordings.glob(f"*{UNFINISHED}")]
    if not written:
        raise BenchError("expected the robot to record, found no recording under way")
    resource.prlimit(pid, resource.RLIMIT_FSIZE, (max(written), resource.RLIM_INFINITY))


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
