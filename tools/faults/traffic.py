"""Others on the road: a robot that stops, one that nobody hears any more, a duck."""

from __future__ import annotations

import math
from dataclasses import replace

from robot.geometry import Pose
from robot.navigation.others import HALF_DUCK_M, HALF_ROBOT_M
from robot.safety.governors import NOSE_M
from tools.faults.case import Act, Case
from tools.faults.stage import Stage
from tools.loop.timekeeper import BenchError

DUCK_M = 0.25  # from the nose to a duck's middle
CLOSES_S = 5.0  # in which the robot has come up to who stands before it, ever slower
DUCK_S = 1.0
FORGETS_S = 7.0  # in which a robot is sure that nobody is there any more
MOVES_S = 0.3
ELSEWHERE = Pose(1.75, 1.17, 0.0)  # inside the loop


def _lead(stage: Stage) -> None:
    """The second robot drives off on the same way, before the first."""
    for kind, goal in (("arm", None), ("mission", stage.goal)):
        accepted, reason = stage.bench.second.ask(kind, goal)
        if not accepted:
            raise BenchError(f"expected {kind} of the second robot to be accepted, got: {reason}")


def _alone(stage: Stage) -> None:
    """The second robot is elsewhere."""
    assert stage.bench.town.second is not None
    stage.bench.town.second.world.place(ELSEWHERE)


def _no_duck(stage: Stage) -> None:
    stage.bench.town.duck = None


def _duck(stage: Stage) -> None:
    town = stage.bench.town
    town.duck = town.pose.moved(NOSE_M + DUCK_M, 0.0)


def _apart(stage: Stage) -> str:
    """What is wrong with the way that is left, from the nose to whom it stands before."""
    town = stage.bench.town
    assert town.second is not None
    other, half_m = (town.duck, HALF_DUCK_M) if town.duck else (town.second.pose, HALF_ROBOT_M)
    left_m = math.dist(town.pose[:2], other[:2]) - NOSE_M - half_m
    return "" if 0.02 < left_m < 0.25 else f"it stands {100.0 * left_m:.0f} cm before it"


def _then_goes_on(stage: Stage) -> str:
    """As `_apart`; then the way is free again, and nobody says so."""
    problem, town = _apart(stage), stage.bench.town
    _no_duck(stage)
    if stage.bench.second.state == "HOLD":
        _lead(stage)
    stage.run(FORGETS_S)
    moves = stage.bench.now_s - town.moved_s < MOVES_S
    return problem or ("" if moves else "the way is free, and it does not go on")


def _cut(stage: Stage, cut: bool = True) -> None:
    stage.bench.networks["monitor2"].cut = cut


def _behind(name: str, what: str, inject: Act, threshold_s: float) -> Case:
    told = "something is", ("AUTO",)
    return Case(name, what, inject, threshold_s, *told, before=_lead, check=_then_goes_on)


DUCK = replace(_behind("duck", "sits down 25 cm ahead", _duck, DUCK_S), heal=_no_duck)
STOPS = _behind("other stops", "in its lane", lambda s: s.bench.second.ask("stop"), CLOSES_S)
DIES = _behind("other's link dies", "it stops in its lane", _cut, 1.0 + CLOSES_S)
DIES = replace(DIES, heal=lambda stage: _cut(stage, False), check=_apart)
CASES = {"traffic": (DUCK, STOPS, DIES), "by sight": (replace(DUCK, before=_alone), STOPS)}
