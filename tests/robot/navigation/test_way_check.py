"""Faults of poses and wheels, met by the way seen against the way stepped."""

from __future__ import annotations

import math
from typing import Callable, List, Optional, Tuple

import numpy as np
import pytest

from robot.geometry import Pose
from robot.navigation.way_check import WayCheck, WayDoubt

FAULT_S = 1.7  # after driving off
Lie = Callable[[np.ndarray, float, np.ndarray], np.ndarray]  # pose, since when [s], pose then


def noisy(rng: np.random.Generator, white_m: float) -> np.ndarray:
    return rng.normal(0.0, (white_m, white_m, 3.0 * white_m))


def drive(
    lie: Optional[Lie] = None,
    held: bool = False,
    white_m: float = 0.002,
    bend: float = 0.9,
    seconds: float = 6.0,
    seed: int = 0,
    check: Optional[WayCheck] = None,
    late_s: float = 0.0,  # by which pictures are older than they say
) -> Tuple[Optional[float], WayDoubt]:
    """When the check doubts a robot that drives at 0.3 m/s, after the fault [s], and what."""
    rng, way = np.random.default_rng(seed), check or WayCheck()
    true, odometry, now_s, then = Pose(1.0, 1.0, 0.3), Pose(-3.0, 2.0, 2.0), 40.0, None
    for _ in range(30):
        now_s += 0.1
        way.stepped(now_s, odometry)
        way.see(now_s - 0.02, Pose(*(np.array(true) + noisy(rng, white_m))))
    way.reset()
    driven_s, doubt = 0.0, way.doubt
    while driven_s < seconds:
        now_s, driven_s = now_s + 0.1, driven_s + 0.1
        since_s = driven_s - FAULT_S
        speed = 0.3 * min(1.0, driven_s / 0.4)
        arc = (0.1 * speed, 0.1 * bend * math.sin(2.5 * driven_s))
        odometry = odometry.moved(*arc)
        true = true if held and since_s > 0.0 else true.moved(*arc)
        seen = np.array(true.moved(-speed * late_s, -arc[1] / 0.1 * late_s))
        if since_s > 0.0 and lie is not None:
            then = seen if then is None else then
            seen = lie(seen, since_s, then)
        way.stepped(now_s, odometry)
        doubt = way.see(now_s, Pose(*(seen + noisy(rng, white_m))))
        if doubt.doubtful:
            return since_s, doubt
    return None, doubt


def drifting(ahead_mps: float = 0.0, left_mps: float = 0.0, turn_radps: float = 0.0) -> Lie:
    def lie(seen: np.ndarray, since_s: float, then: np.ndarray) -> np.ndarray:
        c, s = math.cos(then[2]), math.sin(then[2])
        x_mps, y_mps = c * ahead_mps - s * left_mps, s * ahead_mps + c * left_mps
        return seen + since_s * np.array([x_mps, y_mps, turn_radps])

    return lie


def moved_by(ahead_m: float, left_m: float) -> Lie:
    def lie(seen: np.ndarray, _: float, then: np.ndarray) -> np.ndarray:
        c, s = math.cos(then[2]), math.sin(then[2])
        return seen + np.array([c * ahead_m - s * left_m, s * ahead_m + c * left_m, 0.0])

    return lie


def frozen(_: np.ndarray, _since_s: float, then: np.ndarray) -> np.ndarray:
    return then


@pytest.mark.parametrize("white_m", [0.0, 0.002, 0.005, 0.03])
@pytest.mark.parametrize("bend", [0.0, 0.9, 2.4])
@pytest.mark.parametrize("late_s", [-0.03, 0.0, 0.06])
def test_an_honest_drive_is_no_doubt(white_m: float, bend: float, late_s: float) -> None:
    since_s, doubt = drive(white_m=white_m, bend=bend, seconds=9.0, late_s=late_s)
    assert since_s is None
    assert max(doubt.coarse, doubt.fine) < 0.9


@pytest.mark.parametrize("white_m", [0.0, 0.002, 0.005, 0.015])
@pytest.mark.parametrize("bend", [0.0, 0.9])
@pytest.mark.parametrize("held", [False, True])
def test_poses_that_stand_while_the_wheels_step(white_m: float, bend: float, held: bool) -> None:
    since_s, doubt = drive(None if held else frozen, held, white_m, bend)
    assert since_s is not None
    assert 0.0 < since_s <= 1.0
    assert doubt.stands


DRIFTS = {
    "ahead": drifting(ahead_mps=0.03),
    "back": drifting(ahead_mps=-0.03),
    "left": drifting(left_mps=0.03),
    "right": drifting(left_mps=-0.03),
}


@pytest.mark.parametrize("lie", DRIFTS.values(), ids=list(DRIFTS))
@pytest.mark.parametrize("bend", [0.0, 0.9])
@pytest.mark.parametrize(("white_m", "within_s"), [(0.0, 2.0), (0.001, 2.2)])
def test_poses_that_drift_by_3_cm_in_a_second(
    lie: Lie, bend: float, white_m: float, within_s: float
) -> None:
    since_s, doubt = drive(lie, white_m=white_m, bend=bend)
    assert since_s is not None
    assert since_s <= within_s
    assert not doubt.stands


@pytest.mark.parametrize("lie", DRIFTS.values(), ids=list(DRIFTS))
def test_poses_that_drift_are_noticed_whatever_their_noise_and_the_motors_lag(lie: Lie) -> None:
    for seed in range(12):
        since_s, _ = drive(lie, white_m=0.0015, bend=0.0, seed=seed, late_s=0.05)
        assert since_s is not None
        assert since_s <= 2.6, "a quarter of a second after they are 7 cm off"


@pytest.mark.parametrize("swung", [(0.03, 0.0, 0.0), (0.011, 0.0, 0.3), (-0.02, -0.02, -0.3)])
def test_what_coils_move_that_come_on_is_no_doubt(swung: Tuple[float, ...]) -> None:
    """Rotors of 48 steps a turn swing by some of these before the first step is counted."""
    way, rng, doubts = WayCheck(), np.random.default_rng(0), []
    true, odometry = Pose(1.0, 1.0, 0.3), Pose(0.0, 0.0, 0.0)
    for tick in range(70):
        if tick == 34:
            way.reset()
        if tick == 40:
            true = Pose(*(np.array(true) + swung))
        if tick > 50:
            true, odometry = true.moved(0.03, 0.0), odometry.moved(0.03, 0.0)
        way.stepped(0.1 * tick, odometry)
        doubts.append(way.see(0.1 * tick, Pose(*(np.array(true) + noisy(rng, 0.001)))))
    assert max(max(doubt.fine, doubt.coarse) for doubt in doubts) < 0.3


@pytest.mark.parametrize("turn", [-1.0, 1.0])
def test_headings_that_turn_by_3_degrees_in_a_second(turn: float) -> None:
    since_s, _ = drive(drifting(turn_radps=turn * math.radians(3.0)), seconds=8.0)
    assert since_s is not None
    assert since_s <= 3.5


@pytest.mark.parametrize("white_m", [0.0, 0.001, 0.002])
@pytest.mark.parametrize("place", [(0.08, 0.0), (-0.08, 0.0), (0.0, 0.08), (0.0, -0.08)])
def test_labels_swapped_with_a_robot_beside_that_drives_the_same_way(
    place: Tuple[float, float], white_m: float
) -> None:
    since_s, doubt = drive(moved_by(*place), white_m=white_m)
    assert since_s is not None
    assert since_s <= 0.5
    assert not doubt.stands or place[0] < 0.0  # back by as much as it drove: it seems to stand


@pytest.mark.parametrize(
    "lie",
    [
        lambda seen, _, __: np.array([2.0 - seen[0], seen[1], math.pi - seen[2]]),
        lambda seen, _, __: np.array([1.1 * seen[0], 1.1 * seen[1], seen[2]]),
        lambda seen, _, __: np.array([seen[0], seen[1], -seen[2]]),
    ],
    ids=["mirrored", "scaled", "heading mirrored"],
)
def test_poses_of_another_map(lie: Lie) -> None:
    since_s, _ = drive(lie, bend=0.0)
    assert since_s is not None
    assert since_s <= 1.5


@pytest.mark.parametrize("count", [1, 2])
def test_so_many_outliers_in_a_row_are_no_doubt(count: int) -> None:
    def lie(seen: np.ndarray, since_s: float, _: np.ndarray) -> np.ndarray:
        out = 0.05 < since_s % 2.0 < 0.05 + 0.1 * count
        return seen + (np.array([0.4, -0.3, 0.0]) if out else 0.0)

    assert drive(lie, seconds=12.0)[0] is None


def test_a_new_mission_begins_without_the_old_doubt_and_doubts_again() -> None:
    way = WayCheck()
    drive(frozen, check=way)
    assert way.doubt.doubtful
    way.reset()
    assert not way.doubt.doubtful
    doubts: List[Optional[float]] = [drive(None, check=WayCheck())[0], drive(frozen)[0]]
    assert doubts[0] is None
    assert doubts[1] is not None


@pytest.mark.parametrize("heading_rad", [0.0, 1.0, 2.0, 3.14, -2.0, -1.0])
def test_a_halt_that_late_pictures_tell_late_is_no_doubt_wherever_the_robot_heads(
    heading_rad: float,
) -> None:
    way, now_s, odometry = WayCheck(), 10.0, Pose(0.0, 0.0, 0.0)
    true, late_s, worst = Pose(2.0, 1.0, heading_rad), 0.1, 0.0
    for tick in range(60):
        speed = 0.3 * min(1.0, tick / 4.0, max(0.0, (50 - tick) / 2.0))
        now_s, odometry = now_s + 0.1, odometry.moved(0.1 * speed, 0.0)
        true = true.moved(0.1 * speed, 0.0)
        way.stepped(now_s, odometry)
        worst = max(worst, way.see(now_s, true.moved(-speed * late_s, 0.0)).fine)
    assert worst < 0.2


def test_a_picture_no_newer_than_the_last_changes_nothing() -> None:
    way = WayCheck()
    way.stepped(1.0, Pose(0.0, 0.0, 0.0))
    for _ in range(50):
        assert not way.see(1.0, Pose(5.0, 5.0, 0.0)).doubtful
    assert way.see(0.5, Pose(0.0, 0.0, 0.0)) == WayDoubt()


@pytest.mark.parametrize("bend", [0.0, 0.9])
def test_a_picture_that_is_stretched_by_a_twentieth_for_a_while_is_half_a_doubt(
    bend: float,
) -> None:
    """Met on the bench: 2 cm over 40 cm of a straight road."""
    fine = [0.0]

    class Noted(WayCheck):
        def see(self, captured_s: float, seen: Pose) -> WayDoubt:
            fine.append(super().see(captured_s, seen).fine)
            return self.doubt

    def lie(seen: np.ndarray, since_s: float, then: np.ndarray) -> np.ndarray:
        back_m = 0.015 * min(max(since_s - 3.3, 0.0), 1.4)
        return seen - back_m * np.array([math.cos(then[2]), math.sin(then[2]), 0.0])

    assert drive(lie, bend=bend, seconds=9.0, white_m=0.001, check=Noted())[0] is None
    assert 0.1 < max(fine) < 0.5
