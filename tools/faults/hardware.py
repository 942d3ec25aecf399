"""The motors' bus, the Wi-Fi, for which a proxy of the bench stands, and the computer's limits."""

import resource
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager

from robot.recording.drive_file import UNFINISHED
from sim_pybullet.virtual.i2c import BusFault
from tools.faults.case import sets
from tools.faults.stage import Stage
from tools.loop.timekeeper import BenchError

LASTING = 100_000  # transactions


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
        stage.bench.start_in_vain("robot")
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
    if not recorded or recorded[0]["level"] == "ok":
        return f"the page does not say that nothing is recorded: {recorded}"
    return ""


@contextmanager
def bad(stage: Stage, network: str, **values: float) -> Iterator[None]:
    """A network cut, slow, or losing parts."""
    stage.shared.set("lossy", 1.0)
    vars(stage.bench.networks[network]).update(values)
    yield
    vars(stage.bench.networks[network]).update(cut=False, delay_s=0.0, loss=0.0)
