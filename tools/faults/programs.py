"""The policy's file, signals to programs, a second program, and missions that nobody can drive."""

from __future__ import annotations

import math
import re
import signal
import subprocess
import time
from collections.abc import Callable
from pathlib import Path

from robot.geometry import Pose
from robot.recording.reader import read_turns
from tools.faults.case import AGE_S, HOLD, HOLD_OR_FAULT, Act, Case, change
from tools.faults.hardware import RELEASED_S, coils_off
from tools.faults.stage import Stage
from tools.loop.operator import Operator

SLOW_S = 0.35
LOSS_S = 1.0
PATIENCE_S = 60.0  # real time that a command may take


def _own_model(stage: Stage) -> None:
    stage.bench.use_model(stage.bench.options.model)


def _refused(name: str, what: str, make: Callable[[Path, Path], Path], says: str) -> Case:
    """The robot is started with a file that ``make`` makes of a folder and a good file."""

    def inject(stage: Stage) -> None:
        bench = stage.bench
        bench.stop("robot")
        bench.use_model(make(bench.folder, bench.options.model))
        bench.start_and_end("robot")

    def check(stage: Stage) -> str:
        process = stage.bench.processes["robot"]
        code, last = process.child.returncode, process.said().strip().splitlines()[-1]
        right = code == 2 and says in last
        return "" if right else f"expected status 2 and a line with {says!r}, got {code}: {last}"

    return Case(name, what, inject, moving=False, silent=True, check=check, heal=_own_model)


def _damaged(folder: Path, good: Path) -> Path:
    data = bytearray(good.read_bytes())
    data[100:2000] = bytes(1900)
    (folder / "damaged.onnx").write_bytes(data)
    return folder / "damaged.onnx"


def _seven_points(folder: Path, good: Path) -> Path:
    contract = b'"path_points": 10', b'"path_points":  7'
    (folder / "other.onnx").write_bytes(good.read_bytes().replace(*contract))
    return folder / "other.onnx"


MODEL = (
    _refused("missing", "no such file", lambda folder, _: folder / "none.onnx", "none.onnx"),
    _refused("damaged", "bytes overwritten", _damaged, "onnx"),
    _refused("wrong contract", "seven path points", _seven_points, "path points, got 7"),
    Case(
        *("NaN", "it answers NaN", lambda stage: stage.shared.set("nan", 1.0), 0.1, "finite"),
        heal=lambda stage: stage.shared.set("nan", 0.0),
    ),
    Case(
        *("slow", f"a decision takes {SLOW_S:g} s", lambda stage: stage.shared.set("slow", SLOW_S)),
        *(0.2, "loop|frame"),
        heal=lambda stage: stage.shared.set("slow", 0.0),
    ),
)


def _gone(name: str, how: int, check: Callable[[Stage], str]) -> Case:
    """The robot's program is ended."""
    return Case(
        *(f"robot {name}", "", lambda stage: stage.bench.end("robot", how)),
        silent=True,
        check=check,
    )


def _operator(stage: Stage) -> Operator:
    return stage.bench.operator


def _unwatched(name: str, inject: Act) -> Case:
    return Case(f"monitor {name}", "", inject, AGE_S, "operator", HOLD)


def _coils_off(stage: Stage) -> str:
    return coils_off(stage) or _recorded(stage)


def _recorded(stage: Stage) -> str:
    """Nothing is lost from the recording but its last second."""
    newest = max(stage.bench.recordings.iterdir(), key=lambda path: path.stat().st_mtime)
    last_s = max((turn.time_s for turn, _ in read_turns(newest)), default=-math.inf)
    lost_s = stage.bench.town.moved_s - last_s
    return "" if lost_s <= LOSS_S else f"{lost_s:.1f} s are lost from the recording"


def _beside(command: str) -> Act:
    """Another of the robot's commands, with the robot's own file; time stands still meanwhile.

    It must not find out more of the bench's time than a real one would of the robot's. What it
    says is kept in ``note``, after its status.
    """

    def inject(stage: Stage) -> None:
        bench = stage.bench
        words = ["-m", "robot", command, "--config", str(bench.folder / "robot.yaml")]
        with (bench.folder / "beside.log").open("w+b") as said:
            program = subprocess.Popen(
                [bench.options.robot_python, *words],
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


def _second_refused(stage: Stage) -> str:
    status, _, told = stage.note.strip().partition(" ")
    if status != "1" or len(told.splitlines()) != 1 or "the only program that drives" not in told:
        return f"expected the second to be refused in one line, it says: {stage.note}"
    return ""


PROGRAMS = (
    _gone("SIGTERM", signal.SIGTERM, _coils_off),
    _gone("SIGHUP", signal.SIGHUP, _coils_off),
    _gone("SIGKILL", signal.SIGKILL, _recorded),
    Case("robot SIGSTOP", "and SIGCONT", lambda stage: stage.bench.freeze("robot"), silent=True),
    Case(
        *("robot off", "another program, while it drives", _beside("off")),
        *(RELEASED_S, "another program"),
        check=_switched_off,
        drives_again=True,
    ),
    Case(
        *("second robot drive", "with the same file", _beside("drive")),
        states=(),
        check=_second_refused,
    ),
    _unwatched("SIGTERM", lambda stage: stage.bench.end("monitor", signal.SIGTERM)),
    _unwatched("SIGKILL", lambda stage: stage.bench.end("monitor", signal.SIGKILL)),
    _unwatched("SIGSTOP", lambda stage: stage.bench.freeze("monitor")),
    Case(
        *("page not watched", "it shows nothing any more", change(_operator, watching=False)),
        2.0,  # a second until the monitor falls silent, and one until the robot minds
        *("operator", HOLD),
        heal=change(_operator, watching=True),
    ),
)


def _nowhere(name: str, place: tuple[float, float]) -> Case:
    def inject(stage: Stage) -> None:
        accepted, reason = stage.bench.operator.ask("mission", place, arm=True)
        stage.note = "accepted" if accepted else reason

    def check(stage: Stage) -> str:
        return "" if "road" in stage.note else f"expected to hear of the road, got: {stage.note}"

    what, says = f"arm and drive to {place}", "started|disarm"
    return Case(name, what, inject, 0.0, says, ("DISARMED",), moving=False, check=check)


def _from_elsewhere(stage: Stage) -> None:
    stage.note = stage.bench.operator.ask("mission", stage.goal, arm=True, start=stage.goal)[1]


def _told_how_far(stage: Stage) -> str:
    away_m = math.dist(stage.goal, stage.bench.town.pose[:2])
    found = re.search(r"it is ([0-9.]+) m from there", stage.note)
    near = found is not None and abs(float(found[1]) - away_m) < 0.05
    return "" if near else f"expected to hear of {away_m:.2f} m, got: {stage.note}"


def _carry(name: str, what: str, where: Callable[[Pose], Pose]) -> Case:
    def inject(stage: Stage) -> None:
        stage.bench.town.world.place(where(stage.bench.town.pose))

    # five unbelievable poses in a row, or no believable one for so long
    return Case(name, what, inject, 1.0, states=HOLD_OR_FAULT)


MISSIONS = (
    _nowhere("unreachable", (0.66, 2.0)),
    _nowhere("off the map", (9.0, 9.0)),
    Case(
        *("wrong start", "a mission from where the robot is not", _from_elsewhere),
        states=("DISARMED",),
        moving=False,
        check=_told_how_far,
    ),
    _carry("carried away", "somebody puts it down at (0.66, 2.0)", lambda _: Pose(0.66, 2.0, 0.0)),
    _carry(
        *("turned round", "somebody turns it"),
        lambda pose: pose._replace(heading_rad=pose.heading_rad + 2.2),
    ),
)
CASES = {"model": MODEL, "programs": PROGRAMS, "missions": MISSIONS}
