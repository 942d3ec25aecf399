"""The motors' bus: not acknowledged, stuck, cut off half-way, the chip reset, another program."""

from __future__ import annotations

from sim_pybullet.virtual.i2c import BusFault
from tools.faults.case import Act, Case
from tools.faults.stage import Stage

LASTING = 100_000  # transactions
RELEASED_S = 1.5  # until coils that another program switched off must be noticed
ALL_OFF = b"\xfd\x10"


def _faulty(fault: BusFault, count: int = LASTING) -> Act:
    def inject(stage: Stage) -> None:
        stage.bench.town.bus.inject(fault, count)

    return inject


def _heal(stage: Stage) -> None:
    stage.bench.town.bus.mend()


def _reset(stage: Stage) -> None:
    stage.bench.town.hat.chip.power_cycle()


def _move_away(stage: Stage) -> None:
    stage.bench.town.hat.chip.address = 0x55
    stage.bench.stop("robot")
    stage.bench.start_and_end("robot")


def _move_back(stage: Stage) -> None:
    stage.bench.town.hat.chip.address = 0x6F


def _released(stage: Stage) -> None:
    """As any program that switches the motors off."""
    stage.bench.town.bus.write(0x6F, ALL_OFF)


def _one_channel(stage: Stage) -> None:
    """PWMB of the left motor, which steps do not write."""
    stage.bench.town.bus.write(0x6F, bytes((0x06 + 4 * 13, 0, 0, 0, 0x01)))


def coils_off(stage: Stage) -> str:
    """Whether no output is high."""
    return "the coils carry current" if stage.bench.town.hat.chip.outputs.any_high else ""


def _says_where(stage: Stage) -> str:
    said = stage.bench.processes["robot"].said()
    return "" if "expected a PCA9685 at 0x6F" in said else "its log does not name the address"


CASES = (
    Case("NACK", "nobody acknowledges", _faulty(BusFault.NACK), says="switched off", heal=_heal),
    Case("one NACK", "a single one", _faulty(BusFault.NACK, 1), says="Remote I/O", heal=_heal),
    Case("stuck", "SDA held low", _faulty(BusFault.STUCK), says="switched off", heal=_heal),
    Case(
        "partial write",
        "cut off half-way",
        _faulty(BusFault.PARTIAL),
        says="switched off",
        heal=_heal,
    ),
    Case(
        *("chip reset", "its supply dipped", _reset),
        threshold_s=1.0,  # it is looked at once a second
        says="the chip was reset|pose jumped",  # steps without a turning wheel do not fit poses
        heal=_heal,
    ),
    Case(
        *("released by another program", "all outputs off, once", _released),
        threshold_s=RELEASED_S,
        says="another program",
        check=coils_off,
        drives_again=True,
    ),
    Case(
        *("channel written by another", "a duty of the left motor", _one_channel),
        threshold_s=RELEASED_S,
        says="another program",
        check=coils_off,
    ),
    Case(
        *("wrong address", "the HAT answers at 0x55", _move_away),
        moving=False,
        silent=True,
        check=_says_where,
        heal=_move_back,
    ),
)
