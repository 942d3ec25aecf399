"""Poses that drift away are noticed in bends as on a straight, whatever the wheels' error."""

from __future__ import annotations

import math
from typing import Optional, Tuple

import numpy as np
import pytest

from robot.geometry import Pose
from robot.navigation.way_check import WayCheck
from tests.thorough import count

# Which way, and how long a hard turn lasts within the slight one [s]: wide and tight quarter turns.
BENDS = {"wide left": (1.0, 0.0), "wide right": (-1.0, 0.0), "left": (1.0, 0.4), "right": (-1, 0.4)}
SLIGHT, HARD = (0.3, 0.9), (0.18, 2.4)  # m/s, rad/s
STRAIGHT_S = 4.0  # before each bend: a robot with wheels that are off must have driven a while
DRIFT_MPS = 0.03
WITHIN_S = 2.4  # a quarter of a second later the robot stands, and the poses are 8 cm off


def drive(
    bend: str,
    number: int = 1,
    drifts: Optional[Tuple[float, float]] = None,
    gains: Tuple[float, float] = (1.0, 1.0),
    aside_m: float = 0.0,
    seed: int = 0,
) -> Tuple[Optional[float], float]:
    """When a drift is doubted, after it began [s]; and the worst doubt before.

    ``drifts``: when, after the beginning of the bend of that number [s], and in which direction.
    ``gains``: how far the robot drives and turns for what its wheels count. ``aside_m``: how far
    its board is to the left of the axle's middle.
    """
    rng, way, worst = np.random.default_rng(seed), WayCheck(), 0.0
    true, odometry = Pose(1.0, 1.0, 0.3), Pose(-3.0, 2.0, 2.0)
    side, hard_s = BENDS[bend]
    bend_s = hard_s + (0.5 * math.pi - HARD[1] * hard_s) / SLIGHT[1]
    period_s = STRAIGHT_S + bend_s
    begins_s = (number - 1) * period_s + STRAIGHT_S + (drifts[0] if drifts else 0.0)
    for tick in range(-20, round(10.0 * (number * period_s + 4.0))):
        driven_s = 0.1 * tick
        speed = 0.3 * min(1.0, max(0.0, driven_s) / 0.4)
        turn = 0.25 * math.sin(7.0 * driven_s) if driven_s > 0.0 else 0.0
        bent_s = driven_s % period_s - STRAIGHT_S
        if driven_s > 0.0 and bent_s >= 0.0:
            speed, turn = HARD if 0.3 <= bent_s < 0.3 + hard_s else SLIGHT
            turn *= side
        odometry = odometry.moved(0.1 * speed / gains[0], 0.1 * turn / gains[1])
        true = true.moved(0.1 * speed, 0.1 * turn)
        board = true.to_world(np.array([0.0, aside_m]))
        seen = np.array([*board, true.heading_rad]) + rng.normal(0.0, (1e-3, 1e-3, 3e-3))
        if drifts and driven_s > begins_s:
            along = drifts[1] * math.pi / 4.0
            seen[:2] += (
                DRIFT_MPS * (driven_s - begins_s) * np.array([math.cos(along), math.sin(along)])
            )
        way.stepped(50.0 + driven_s, odometry)
        if tick == 0:
            way.reset()
        doubt = way.see(50.0 + driven_s - 0.03, Pose(*seen))
        if drifts is None or driven_s <= begins_s:
            worst = max(worst, doubt.coarse, doubt.fine)
        elif doubt.doubtful:
            return driven_s - begins_s, worst
    return None, worst


@pytest.mark.slow
@pytest.mark.parametrize(
    ("number", "gains"),
    [(1, (0.92, 1.1)), (2, (1.08, 0.85)), (1, (1.0, 1.0)), (2, (1.0, 1.0))][: count(2, 4)],
)
@pytest.mark.parametrize("bend", BENDS)
def test_a_drift_that_begins_at_a_bend_is_noticed_in_time(
    bend: str, number: int, gains: Tuple[float, float]
) -> None:
    for nth, begins_s in enumerate((-0.5, 0.0, 0.5)):
        for eighth in range(nth % 2, 8, 2):
            since_s, before = drive(bend, number, (begins_s, eighth), gains, seed=eighth)
            assert before < 0.9, (begins_s, eighth)
            assert since_s is not None, (begins_s, eighth)
            assert since_s <= WITHIN_S, (begins_s, eighth)


@pytest.mark.parametrize("aside_m", [-0.01, 0.01])
@pytest.mark.parametrize("gains", [(1.0, 1.0), (0.92, 1.1), (1.08, 0.85)])
@pytest.mark.parametrize("bend", BENDS)
def test_two_honest_bends_are_no_doubt(
    bend: str, gains: Tuple[float, float], aside_m: float
) -> None:
    assert drive(bend, 2, None, gains, aside_m)[1] < 0.9
