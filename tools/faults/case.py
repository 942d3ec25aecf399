"""A fault as a row of a table, and what came of it."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from tools.faults.stage import Stage
    from tools.loop.picture_server import PictureServer

Act = Callable[["Stage"], object]
STOP_BUDGET_S = 0.25  # from the moment that a fault counts as one, until the last step
AGE_S = 1.0  # of the newest overhead pose, and of the operator's last sign of life
HOLD = ("HOLD",)
HOLD_OR_FAULT = ("HOLD", "FAULT")


def nothing(_: Stage) -> str:
    """Neither breaks nor mends nor complains."""
    return ""


def the_camera(stage: Stage) -> PictureServer:
    """The robot's."""
    return stage.bench.town.camera


def change(part: Callable[[Stage], object], **values: object) -> Act:
    """Set attributes of a part of the stage."""

    def act(stage: Stage) -> None:
        for name, value in values.items():
            setattr(part(stage), name, value)

    return act


@dataclass(frozen=True)
class Case:
    """One fault, met while the robot drives a mission (unless ``moving`` is False)."""

    name: str  # short, unique in its family
    what: str  # the fault in words
    inject: Act  # breaks something
    threshold_s: float = 0.0  # age at which it counts; the wheels stop ``STOP_BUDGET_S`` later
    says: str = ""  # what the reason shown must contain, a regular expression
    states: tuple[str, ...] = ("FAULT",)  # to be shown, any of them; none: it must drive on
    heal: Act = nothing  # mends it; nothing may begin to move by that
    before: Act = nothing  # prepares the bench, before the robot drives off
    approach: Act = nothing  # lets it drive on to where the fault comes
    moving: bool = True
    silent: bool = False  # the page must say that the robot is silent
    check: Callable[[Stage], str] = nothing  # a last look before mending; what is wrong, or ""
    drives_again: bool = False  # mended, and armed by a person, without a new start


@dataclass(frozen=True)
class Outcome:
    """What a case came to; times in seconds of the bench's clock, NaN where nothing had to stop."""

    family: str
    name: str
    what: str
    stopped_s: float = math.nan  # from the fault to the last step of a motor
    threshold_s: float = 0.0
    state: str = ""
    reason: str = ""
    problem: str = ""  # none when all was as it must be

    @property
    def passed(self) -> bool:
        """Whether all was as it must be."""
        return not self.problem
