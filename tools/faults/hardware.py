"""The motors' bus, the Wi-Fi, for which a proxy of the bench stands, and a full disk."""

from __future__ import annotations

import resource

from robot.recording.drive_file import UNFINISHED
from sim_pybullet.virtual.i2c import BusFault, VirtualI2cBus
from tools.faults.case import AGE_S, HOLD, Case, change
from tools.faults.stage import Stage
from tools.loop.timekeeper import BenchError

LASTING = 100_000  # transactions
RELEASED_S = 1.5  # until coils that another program switched off must be noticed
ALL_OFF = b"\xfd\x10"
LEFT_PWM_OFF = bytes((0x06 + 4 * 13, 0, 0, 0, 0x01))  # PWMB, which steps do not write


def _bus(stage: Stage) -> VirtualI2cBus:
    return stage.bench.town.bus


def _mend(stage: Stage) -> None:
    _bus(stage).mend()


def _faulty(name: str, what: str, fault: BusFault, says: str, count: int = LASTING) -> Case:
    return Case(name, what, lambda s: _bus(s).inject(fault, count), says=says, heal=_mend)


def _written(name: str, what: str, data: bytes, drives_again: bool) -> Case:
    """As any program that writes to the chip."""
    return Case(
        *(name, what, lambda stage: _bus(stage).write(0x6F, data), RELEASED_S, "another program"),
        check=coils_off,
        drives_again=drives_again,
    )


def _move_away(stage: Stage) -> None:
    stage.bench.town.hat.chip.address = 0x55
    stage.bench.stop("robot")
    stage.bench.start_and_end("robot")


def coils_off(stage: Stage) -> str:
    """Whether no output is high."""
    return "the coils carry current" if stage.bench.town.hat.chip.outputs.any_high else ""


def _says_where(stage: Stage) -> str:
    said = stage.bench.processes["robot"].said()
    return "" if "expected a PCA9685 at 0x6F" in said else "its log does not name the address"


I2C = (
    _faulty("NACK", "nobody acknowledges", BusFault.NACK, "switched off"),
    _faulty("one NACK", "a single one", BusFault.NACK, "Remote I/O", 1),
    _faulty("stuck", "SDA held low", BusFault.STUCK, "switched off"),
    _faulty("partial write", "cut off half-way", BusFault.PARTIAL, "switched off"),
    Case(
        *("chip reset", "its supply dipped", lambda stage: stage.bench.town.hat.chip.power_cycle()),
        1.0,  # it is looked at once a second
        "the chip was reset|pose jumped",  # steps without a turning wheel do not fit poses
        heal=_mend,
    ),
    _written("released by another program", "all outputs off, once", ALL_OFF, True),
    _written("channel written by another", "a duty of the left motor", LEFT_PWM_OFF, False),
    Case(
        *("wrong address", "the HAT answers at 0x55", _move_away),
        moving=False,
        silent=True,
        check=_says_where,
        heal=change(lambda stage: stage.bench.town.hat.chip, address=0x6F),
    ),
)


def _may_write(stage: Stage, most: int) -> None:
    pid = stage.bench.processes["robot"].child.pid
    resource.prlimit(pid, resource.RLIMIT_FSIZE, (most, resource.RLIM_INFINITY))


def _full(stage: Stage) -> None:
    """The recording that is being written may grow no more, nor may what is smaller."""
    written = [path.stat().st_size for path in stage.bench.recordings.glob(f"*{UNFINISHED}")]
    if not written:
        raise BenchError("expected the robot to record, found no recording under way")
    _may_write(stage, max(written))


def _told(stage: Stage) -> str:
    readings = stage.bench.operator.robot.get("health", ())
    told = [reading for reading in readings if "record" in reading["name"]]
    if not told or told[0]["level"] == "ok":
        return f"the page does not say that nothing is recorded: {told}"
    return ""


RECORDING = (
    Case(
        *("disk full", "no file may grow any more", _full),
        1.5,  # what is recorded reaches the disk once a second
        states=(),
        heal=lambda stage: _may_write(stage, resource.RLIM_INFINITY),
        check=_told,
    ),
)


def _good(stage: Stage) -> None:
    for network in stage.bench.networks.values():
        network.cut, network.delay_s, network.loss = False, 0.0, 0.0


def _bad(network: str, name: str, what: str, says: str = "", **values: float) -> Case:
    """With ``says`` the robot holds, else it drives on."""

    def inject(stage: Stage) -> None:
        stage.shared.set("lossy", 1.0)
        change(lambda stage: stage.bench.networks[network], **values)(stage)

    name = f"{network} {name}"
    if not says:
        return Case(name, what, inject, states=(), heal=_good)
    silent = network == "monitor"
    return Case(name, what, inject, AGE_S, says, HOLD, heal=_good, silent=silent)


NETWORK = (
    _bad("poses", "cut", "no packet passes", "overhead pose", cut=True),
    _bad("poses", "2 s late", "each packet", "overhead pose", delay_s=2.0),
    _bad("poses", "0.15 s late", "each packet", delay_s=0.15),
    _bad("poses", "lossy", "a fifth is sent again", loss=0.2),
    _bad("monitor", "cut", "no packet passes", "operator", cut=True),
    _bad("monitor", "2 s late", "each packet", "operator", delay_s=2.0),
    _bad("monitor", "0.15 s late", "each packet", delay_s=0.15),
    _bad("monitor", "lossy", "a fifth again", loss=0.2, again_s=0.2),
)
CASES = {"I2C": I2C, "network": NETWORK, "recording": RECORDING}
