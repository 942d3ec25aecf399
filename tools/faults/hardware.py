"""The motors' bus, the Wi-Fi, for which a proxy of the bench stands, and a full disk."""

import resource
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial

from robot.recording.drive_file import UNFINISHED
from sim_pybullet.virtual.i2c import BusFault
from tools.faults.case import cases, sets
from tools.faults.stage import Stage
from tools.loop.timekeeper import BenchError

LASTING = 100_000  # transactions


@contextmanager
def faulty(stage: Stage, fault: str, count: int = LASTING) -> Iterator[None]:
    """So many transactions fail."""
    stage.bench.town.bus.inject(BusFault[fault], count)
    yield
    stage.bench.town.bus.mend()


def power_cycle(stage: Stage) -> None:
    """The chip forgets everything."""
    stage.bench.town.hat.chip.power_cycle()


def written(stage: Stage, data: str) -> None:
    """Another program writes this, hexadecimal."""
    stage.bench.town.bus.write(0x6F, bytes.fromhex(data))


@contextmanager
def moved_to(stage: Stage, address: int) -> Iterator[None]:
    """The chip answers elsewhere, and the robot is started."""
    with sets(stage, "bench.town.hat.chip", address=address):
        stage.bench.stop("robot")
        stage.bench.start_and_end("robot")
        yield


def coils_off(stage: Stage) -> str:
    """Whether no output is high."""
    return "the coils carry current" if stage.bench.town.hat.chip.outputs.any_high else ""


def says_where(stage: Stage) -> str:
    """Whether the robot says where it looked."""
    said = stage.bench.processes["robot"].said()
    return "" if "expected a PCA9685 at 0x6F" in said else "its log does not name the address"


@contextmanager
def full(stage: Stage) -> Iterator[None]:
    """The recording that is being written may grow no more, nor may what is smaller."""
    written = [path.stat().st_size for path in stage.bench.recordings.glob(f"*{UNFINISHED}")]
    if not written:
        raise BenchError("expected the robot to record, found no recording under way")
    limit = partial(
        resource.prlimit, stage.bench.processes["robot"].child.pid, resource.RLIMIT_FSIZE
    )
    limit((max(written), resource.RLIM_INFINITY))
    yield
    limit((resource.RLIM_INFINITY, resource.RLIM_INFINITY))


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


CASES = cases(__name__, "I2C", "network", "recording")
