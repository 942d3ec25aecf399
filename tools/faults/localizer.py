"""The poses: none, late, in the wrong order, jumping, doubled, by a clock that was set."""

from __future__ import annotations

import signal
from collections.abc import Callable

from tools.faults.case import Act, Case
from tools.faults.stage import Stage
from tools.faults.stand_in import StandIn

POSE_AGE_S = 1.0
HOLD = ("HOLD",)


def _ended(how: int) -> Act:
    def inject(stage: Stage) -> None:
        stage.bench.end("localizer", how)

    return inject


def _paused(stage: Stage) -> None:
    stage.bench.freeze("localizer")


def _lies(change: Callable[[StandIn], None]) -> Act:
    """From now on the stand-in, which `Case.before` has put in place, does this."""

    def inject(stage: Stage) -> None:
        assert stage.stand_in is not None
        change(stage.stand_in)

    return inject


def _set(name: str, value: float) -> Callable[[StandIn], None]:
    return lambda stand_in: setattr(stand_in, name, value)


def _stand_in(stage: Stage) -> None:
    stage.replace_localizer()


def _case(name: str, what: str, change: Callable[[StandIn], None], **more: object) -> Case:
    return Case(name, what, _lies(change), before=_stand_in, **more)  # type: ignore[arg-type]


CASES = (
    Case("killed", "SIGKILL", _ended(signal.SIGKILL), POSE_AGE_S, HOLD, "overhead pose"),
    Case("ended", "SIGTERM", _ended(signal.SIGTERM), POSE_AGE_S, HOLD, "overhead pose"),
    Case("paused", "SIGSTOP", _paused, POSE_AGE_S, HOLD, "overhead pose"),
    _case(
        *("late", "every pose 1.5 s late", _set("late_s", 1.5)),
        threshold_s=POSE_AGE_S,
        states=HOLD,
        says="overhead pose",
    ),
    _case(
        *("out of order", "sequence numbers that fall", _set("backwards", True)),
        threshold_s=POSE_AGE_S,
        states=HOLD,
        says="overhead pose",
    ),
    _case(
        *("jumping", "one metre to the east at once", _set("jump_m", 1.0)),
        threshold_s=0.6,  # five unbelievable poses in a row
        states=("FAULT", "HOLD"),
        says="jumped|overhead pose",
    ),
    _case(
        *("doubled", "two sessions take turns", _set("twins", True)),
        threshold_s=0.4,
        says="two localizers",
    ),
    _case(
        *("clock set back", "its clock loses 100 s", _set("clock_step_s", -100.0)),
        threshold_s=POSE_AGE_S,
        states=("HOLD", "FAULT"),
    ),
    _case("clock set forward", "its clock gains 100 s", _set("clock_step_s", 100.0), states=()),
)
