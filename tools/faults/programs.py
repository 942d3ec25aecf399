"""Signals to robot and monitor, and a second program at the robot's motors."""

from __future__ import annotations

import math
import signal
import subprocess
import time

from robot.recording.reader import read_turns
from tools.faults.case import Act, Case
from tools.faults.i2c import RELEASED_S, coils_off
from tools.faults.stage import Stage

LINK_AGE_S = 1.0
LOSS_S = 1.0
PATIENCE_S = 60.0  # real time that a command may take
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
    return coils_off(stage) or _recorded(stage)


def _beside(*arguments: str) -> Act:
    """Another of the robot's commands, with the robot's own file; time stands still meanwhile.

    It must not find out more of the bench's time than a real one would of the robot's. What it
    says is kept in ``note``, after its status.
    """

    def inject(stage: Stage) -> None:
        bench = stage.bench
        config = ["--config", str(bench.folder / "robot.yaml")]
        with (bench.folder / "beside.log").open("w+b") as said:
            program = subprocess.Popen(
                [bench.options.robot_python, "-m", "robot", *arguments, *config],
                stdin=subprocess.DEVNULL,
                stdout=said,
                stderr=subprocess.STDOUT,
            )
            deadline_s = time.monotonic() + PATIENCE_S
            while program.poll() is None and time.monotonic() < deadline_s:
                bench.time.settle()
                time.sleep(0.005)
            program.kill()
            said.seek(0)
            stage.note = f"{program.wait()} {said.read().decode('utf-8', 'replace')}"

    return inject


def _switched_off(stage: Stage) -> str:
    if not (stage.note.startswith("0 ") and "all outputs off at 0x6F" in stage.note):
        return f"expected robot off to work, it says: {stage.note}"
    return coils_off(stage)


def _refused(stage: Stage) -> str:
    status, _, told = stage.note.strip().partition(" ")
    if status != "1" or len(told.splitlines()) != 1 or "the only program that drives" not in told:
        return f"expected the second to be refused in one line, it says: {stage.note}"
    return ""


def _recorded(stage: Stage) -> str:
    """Nothing is lost from the recording but its last second."""
    newest = max(stage.bench.recordings.iterdir(), key=lambda path: path.stat().st_mtime)
    last_s = max((turn.time_s for turn, _ in read_turns(newest)), default=-math.inf)
    lost_s = stage.bench.town.moved_s - last_s
    return "" if lost_s <= LOSS_S else f"{lost_s:.1f} s are lost from the recording"


CASES = (
    Case("robot SIGTERM", "", _ended("robot", signal.SIGTERM), silent=True, check=_coils_off),
    Case("robot SIGHUP", "", _ended("robot", signal.SIGHUP), silent=True, check=_coils_off),
    Case("robot SIGKILL", "", _ended("robot", signal.SIGKILL), silent=True, check=_recorded),
    Case("robot SIGSTOP", "and SIGCONT", _paused("robot"), silent=True),
    Case(
        *("robot off", "another program, while it drives", _beside("off")),
        threshold_s=RELEASED_S,
        says="another program",
        check=_switched_off,
        drives_again=True,
    ),
    Case(
        *("second robot drive", "with the same file", _beside("drive")),
        states=(),
        check=_refused,
    ),
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
