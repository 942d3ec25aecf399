"""The motors' bus, the Wi-Fi, for which a proxy of the bench stands, and the computer's limits.

The policy's file, signals to programs, a second program, and missions that nobody can drive.
"""

import math
import re
import resource
import time
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager

from robot.recording.drive_file import UNFINISHED
from robot.recording.reader import read_turns
from sim_pybullet.virtual.i2c import BusFault
from tools.faults.case import sets
from tools.faults.stage import Stage
from tools.loop.process import Process
from tools.loop.timekeeper import BenchError

LASTING = 100_000  # transactions
LOSS_S = 1.0
PATIENCE_S = 60.0  # real time that a command may take


@contextmanager
def faulty(stage: Stage, fault: str, count: int = LASTING) -> Iterator[None]:
    """So many transactions fail."""
    stage.bench.town.bus.inject(BusFault[fault], count)
    yield
    stage.bench.town.bus.mend()


def written(stage: Stage, data: str) -> None:
    """Another program writes this, hexadecimal."""
    stage.bench.town.bus.write(0x6F, bytes.fromhex(data))


@contextmanager
def moved_to(stage: Stage, address: int) -> Iterator[None]:
    """The chip answers elsewhere, and the robot is started."""
    with sets(stage, "bench.town.hat.chip", address=address):
        stage.bench.start_in_vain()
        yield


def coils_off(stage: Stage) -> str:
    """Whether no output is high."""
    return "the coils carry current" if stage.bench.town.hat.chip.outputs.any_high else ""


@contextmanager
def limited(stage: Stage, what: int, most: int) -> Iterator[None]:
    """The robot's process may have no more than so much of a resource."""
    robot = stage.bench.processes["robot"]
    before = resource.prlimit(robot.child.pid, what)
    resource.prlimit(robot.child.pid, what, (most, before[1]))
    yield
    if robot.alive:
        resource.prlimit(robot.child.pid, what, before)


@contextmanager
def no_descriptors(stage: Stage) -> Iterator[None]:
    """The robot may open no file any more, and its camera has hung up."""
    with limited(stage, resource.RLIMIT_NOFILE, 3):
        stage.bench.town.camera.hang_up()
        yield


def full(stage: Stage) -> AbstractContextManager[None]:
    """The recording that is being written may grow no more, nor may what is smaller."""
    written = [path.stat().st_size for path in stage.bench.recordings.glob(f"*{UNFINISHED}")]
    if not written:
        raise BenchError("expected the robot to record, found no recording under way")
    return limited(stage, resource.RLIMIT_FSIZE, max(written))


def told(stage: Stage) -> str:
    """Whether the page says that nothing is recorded."""
    readings = stage.bench.operator.robot.get("health", ())
    recorded = [reading for reading in readings if "record" in reading["name"]]
    silent = not recorded or recorded[0]["level"] == "ok"
    return f"the page does not say that nothing is recorded: {recorded}" if silent else ""


@contextmanager
def bad(stage: Stage, network: str, **values: float) -> Iterator[None]:
    """A network cut, slow, or losing parts."""
    stage.shared.set("lossy", 1.0)
    vars(stage.bench.networks[network]).update(values)
    yield
    vars(stage.bench.networks[network]).update(cut=False, delay_s=0.0, loss=0.0)


@contextmanager
def started_with(stage: Stage, how: str) -> Iterator[None]:
    """The robot is started with a policy's file that is ``none``, or made of a good one."""
    bench = stage.bench
    path, data = bench.folder / f"{how}.onnx", bytearray(bench.options.model.read_bytes())
    if how == "damaged":
        data[100:2000] = bytes(1900)
    if how != "none":
        path.write_bytes(data.replace(b'"path_points": 10', b'"path_points":  7'))
    try:
        bench.use_model(path)
        bench.start_in_vain()
        yield
    finally:
        bench.use_model(bench.options.model)


def refused(stage: Stage, says: str) -> str:
    """Whether the robot ended with a line that says why."""
    process = stage.bench.processes["robot"]
    code, last = process.child.returncode, process.said().strip().splitlines()[-1]
    right = code == 2 and says in last
    return "" if right else f"expected status 2 and a line with {says!r}, got {code}: {last}"


@contextmanager
def shares(stage: Stage, slot: str, value: float) -> Iterator[None]:
    """What the robot's process reads there."""
    stage.shared.set(slot, value)
    yield
    stage.shared.set(slot, 0.0)


def recorded(stage: Stage) -> str:
    """Nothing is lost from the recording but its last second."""
    newest = max(stage.bench.recordings.iterdir(), key=lambda path: path.stat().st_mtime)
    last_s = max((turn.time_s for turn, _ in read_turns(newest)), default=-math.inf)
    lost_s = stage.bench.town.moved_s - last_s
    return "" if lost_s <= LOSS_S else f"{lost_s:.1f} s are lost from the recording"


def beside(stage: Stage, command: str) -> None:
    """Another of the robot's commands, with the robot's own file; time stands still meanwhile.

    It must not find out more of the bench's time than a real one would of the robot's. What it
    says is kept in ``note``, after its status.
    """
    bench = stage.bench
    words = ["-m", "robot", command, "--config", str(bench.folder / "robot.yaml")]
    log = bench.folder / f"beside-{command}.log"
    program = Process("beside", [bench.options.robot_python, *words], log)
    deadline_s = time.monotonic() + PATIENCE_S
    while program.alive and time.monotonic() < deadline_s:
        bench.time.settle()
        time.sleep(0.005)
    program.end()
    stage.note = f"{program.child.returncode} {program.said()}"


def noted(stage: Stage, pattern: str) -> str:
    """Whether what was answered fits a regular expression."""
    fits = re.search(pattern, stage.note)
    return "" if fits else f"expected an answer with {pattern!r}, got: {stage.note}"


def sent_to(stage: Stage, x_m: float, y_m: float) -> None:
    """Armed and sent to a place."""
    accepted, reason = stage.bench.operator.ask("mission", (x_m, y_m), arm=True)
    stage.note = "accepted" if accepted else reason


def from_elsewhere(stage: Stage) -> None:
    """Sent from where it is not."""
    stage.note = stage.bench.operator.ask("mission", stage.goal, arm=True, start=stage.goal)[1]


def told_how_far(stage: Stage) -> str:
    """Whether it was refused for that."""
    away_m = math.dist(stage.goal, stage.bench.town.pose[:2])
    found = re.search(r"it is ([0-9.]+) m from there", stage.note)
    near = found is not None and abs(float(found[1]) - away_m) < 0.05
    return "" if near else f"expected to hear of {away_m:.2f} m, got: {stage.note}"


def turned(stage: Stage, by_rad: float) -> None:
    """Somebody turns it."""
    pose = stage.bench.town.pose
    stage.bench.town.world.place(pose._replace(heading_rad=pose.heading_rad + by_rad))
