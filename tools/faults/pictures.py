"""Pictures that are of no use: a covered lens, noise, a picture turned, torn or held."""

from __future__ import annotations

from tools.faults.case import Act, Case
from tools.faults.spoil import (
    BLIND_S,
    LIKE_A_BEND_S,
    SPOILED,
    STILL_S,
    WRONG_S,
    Moment,
    Spoil,
    covered,
)
from tools.faults.stage import Stage

# One bare colour may be taken for a frozen picture first; where a wrong picture has led the robot
# off its path first, that is as good.
SAYS = {
    BLIND_S: "lens covered|same picture",
    STILL_S: "has not moved|left its planned path",
    WRONG_S: "road lies|left its planned path",
    LIKE_A_BEND_S: "road lies|left its planned path",
}


def _set(stage: Stage, spoil: Spoil | None) -> None:
    stage.bench.town.camera.spoil = spoil


def _heal(stage: Stage) -> None:
    _set(stage, None)


def _inject(name: str) -> Act:
    return lambda stage: _set(stage, SPOILED[name].make())


def _stops(name: str) -> Case:
    what, _, threshold_s = SPOILED[name]
    states = ("FAULT", "HOLD") if threshold_s >= STILL_S else ("FAULT",)
    return Case(
        *(name, what, _inject(name), threshold_s, states),
        says=SAYS[threshold_s],
        heal=_heal,
    )


def _drives(name: str, what: str, spoil: Spoil, pictures: int) -> Case:
    def inject(stage: Stage) -> None:
        _set(stage, Moment(spoil, pictures))

    return Case(name, what, inject, states=(), heal=_heal)


CASES = (
    *(_stops(name) for name in SPOILED if name != "half covered"),
    _drives("glare", "white for 0.2 s: it must drive on", covered(255), 3),
    _drives("one odd picture", "noise in one picture: it must drive on", covered(128, 90), 1),
)
