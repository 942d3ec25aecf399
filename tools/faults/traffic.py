"""Others on the road: a robot that stops, one that nobody hears any more, a duck."""

import math
from collections.abc import Iterator
from contextlib import contextmanager

from robot.geometry import Pose
from robot.navigation.neighbours import HALF_DUCK_M, HALF_ROBOT_M
from robot.safety.governors import NOSE_M
from tools.faults.stage import Stage, expect

FORGETS_S = 7.0  # in which a robot is sure that nobody is there any more
MOVES_S = 0.3
ELSEWHERE = Pose(1.75, 1.17, 0.0)  # inside the loop


def lead(stage: Stage) -> None:
    """The second robot drives off on the same way, before the first."""
    expect(stage.bench.second, "arm")
    expect(stage.bench.second, "mission", stage.goal)


def alone(stage: Stage) -> None:
    """The second robot is elsewhere."""
    assert stage.bench.town.second is not None
    stage.bench.town.second.world.place(ELSEWHERE)


@contextmanager
def duck(stage: Stage, ahead_m: float) -> Iterator[None]:
    """One sits down, its middle so far before the nose."""
    town = stage.bench.town
    town.duck = town.pose.moved(NOSE_M + ahead_m, 0.0)
    yield
    town.duck = None


def apart(stage: Stage) -> str:
    """What is wrong with the way that is left, from the nose to whom it stands before."""
    town = stage.bench.town
    assert town.second is not None
    other, half_m = (town.duck, HALF_DUCK_M) if town.duck else (town.second.pose, HALF_ROBOT_M)
    left_m = math.dist(town.pose[:2], other[:2]) - NOSE_M - half_m
    return "" if 0.02 < left_m < 0.25 else f"it stands {100.0 * left_m:.0f} cm before it"


def goes_on(stage: Stage) -> str:
    """As `apart`; then the way is free again, and nobody says so."""
    problem, town, page = apart(stage), stage.bench.town, stage.bench.operator
    town.duck = None
    if stage.bench.second.state == "HOLD":
        lead(stage)
    stage.run(FORGETS_S)
    if not problem and stage.bench.now_s - town.moved_s > MOVES_S:
        problem = f"the way is free, and it stands, {page.state}: {page.reason}"
    return problem
