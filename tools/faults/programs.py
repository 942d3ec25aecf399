"""SIGTERM, SIGKILL and SIGSTOP of robot and monitor."""

from __future__ import annotations

import math
import signal

from robot.recording.reader import read_turns
from tools.faults.case import Act, Case
from tools.faults.stage import Stage

LINK_AGE_S = 1.0
LOSS_S = 1.0
HOLD = ("HOLD",)


def _ended(name: str, how: int) -> Act:
    def inject(stage: Stage) -> None:
        stage.bench.end(name, how)

    return inject


def _paused(name: str) -> Act:
    def inject(stage: Stage) -> None:
        stage.bench.freeze(name)

    return inject


def _page_closed(stage: Stage) -> None:
    stage.bench.operator.watching = False


def _page_open(stage: Stage) -> None:
    stage.bench.operator.watching = True


def _coils_off(stage: Stage) -> str:
    if stage.bench.town.hat.chip.outputs.any_high:
        return "the coils carry current"
    return _recorded(stage)


def _recorded(stage: Stage) -> str:
    """Nothing is lost from the recording but its last second."""
    newest = max(stage.bench.recordings.iterdir(), key=lambda path: path.stat().st_mtime)
    last_s = max((turn.time_s for turn, _ in read_turns(newest)), default=-math.inf)
    lost_s = stage.bench.town.moved_s - last_s
    return "" if lost_s <= LOSS_S else f"{lost_s:.1f} s are lost from the recording"


CASES = (
    Case("robot SIGTERM", "", _ended("robot", signal.SIGTERM), silent=True, check=_coils_off),
    Case("robot SIGKILL", "", _ended("robot", signal.SIGKILL), silent=True, check=_recorded),
    Case("robot SIGSTOP", "and SIGCONT", _paused("robot"), silent=True),
    Case("monitor SIGTERM", "", _ended("monitor", signal.SIGTERM), LINK_AGE_S, HOLD, "operator"),
    Case("monitor SIGKILL", "", _ended("monitor", signal.SIGKILL), LINK_AGE_S, HOLD, "operator"),
    Case("monitor SIGSTOP", "", _paused("monitor"), LINK_AGE_S, HOLD, "operator"),
    Case(
        *("page not watched", "it shows nothing any more", _page_closed),
        threshold_s=2.0,  # a second until the monitor falls silent, and one until the robot minds
        states=HOLD,
        says="operator",
        heal=_page_open,
    ),
)
