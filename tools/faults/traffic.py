"""Others on the road: a robot that stops, one that nobody hears any more, a duck."""

from __future__ import annotations

import math

from robot.navigation.others import HALF_DUCK_M, HALF_ROBOT_M
from robot.safety.governors import NOSE_M
from tools.faults.case import Act, Case
from tools.faults.stage import Stage
from tools.loop.timekeeper import BenchError

DUCK_M = 0.25  # from the nose to a duck's middle
CLOSES_S = 5.0  # in which the robot has come up to who stands before it, ever slower
DUCK_S = 1.0


def _lead(stage: Stage) -> None:
    """The second robot drives off on the same way, before the first."""
    for kind, goal in (("arm", None), ("mission", stage.goal)):
        accepted, reason = stage.bench.second.ask(kind, goal)
        if not accepted:
            raise BenchError(f"expected {kind} of the second robot to be accepted, got: {reason}")


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


def _cut(stage: Stage, cut: bool = True) -> None:
    stage.bench.networks["monitor2"].cut = cut


def _behind(name: str, what: str, inject: Act, threshold_s: float, heal: Act) -> Case:
    states, says = ("AUTO",), "something is"
    return Case(name, what, inject, threshold_s, says, states, heal, _lead, check=_apart)


TRAFFIC = (
    _behind("duck", "sits down 25 cm ahead", _duck, DUCK_S, _no_duck),
    _behind("other stops", "in its lane", lambda s: s.bench.second.ask("stop"), CLOSES_S, _no_duck),
    _behind(
        *("other's link dies", "it stops in its lane", _cut, 1.0 + CLOSES_S),
        lambda stage: _cut(stage, False),
    ),
)
CASES = {"traffic": TRAFFIC}
