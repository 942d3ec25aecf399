"""Poses and wheels that tell two ways: a robot that stays, a picture that stays, poses that drift.

The way seen against the way stepped (`robot.navigation.way_check`), and localizers that tell no
poses of repeated pictures.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from robot.geometry import Pose
from sim_pybullet.virtual.world import PHYSICS_DT_S
from tools.faults.case import Act, Case
from tools.faults.stage import Stage
from tools.loop.timekeeper import Event

FROZEN_S, HELD_S, SWAPPED_S = 1.0, 1.5, 2.0
DRIFT_MPS = 0.03
DRIFTED_S = 2.4  # a quarter of a second later the poses are 8 cm off
TURN_RADPS = math.radians(3.0)
TURNED_S = 5.0
NOISE = 3.0  # of the overhead sensor, grey levels
SAYS = "wheels"
Again = Callable[[np.ndarray, np.random.Generator], np.ndarray]


def _same(picture: np.ndarray, _: np.random.Generator) -> np.ndarray:
    return picture


def _noisy(picture: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    grain = rng.normal(0.0, NOISE, picture.shape)
    return np.asarray(np.clip(picture + grain, 0.0, 255.0).astype(np.uint8))


def _flickering(picture: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    flickers = picture.copy()
    flickers[300, 400] = rng.integers(0, 256, 3)
    return flickers


def _freeze(again: Again) -> Act:
    def inject(stage: Stage) -> None:
        server = stage.bench.town.overhead
        frozen = stage.bench.town.see_above()
        server.see = lambda: again(frozen, stage.rng)

    return inject


def _thaw(stage: Stage) -> None:
    stage.bench.town.overhead.see = stage.bench.town.see_above


def _frozen(name: str, what: str, again: Again, says: str, state: str) -> Case:
    name = f"overhead {name}"
    return Case(name, what, _freeze(again), FROZEN_S, (state,), says, heal=_thaw)


class Hands:
    """Keep a robot where it is, whatever its wheels do."""

    def __init__(self, turns: bool = False, aside_m: float = 0.0) -> None:
        self._turns, self._aside_m = turns, aside_m
        self._event: Event | None = None

    def hold(self, stage: Stage) -> None:
        """From now on."""
        world = stage.bench.town.world
        x_m, y_m, heading_rad = world.pose
        x_m -= self._aside_m * math.sin(heading_rad)
        y_m += self._aside_m * math.cos(heading_rad)

        def keep() -> None:
            turned_rad = world.pose.heading_rad if self._turns else heading_rad
            world.place(Pose(x_m, y_m, turned_rad))

        self._event = stage.bench.time.every(PHYSICS_DT_S, keep)

    def let_go(self, stage: Stage) -> None:
        """Take them away."""
        if self._event is not None:
            stage.bench.time.forget(self._event)
            self._event = None


def _held(name: str, what: str, hands: Hands) -> Case:
    return Case(name, what, hands.hold, HELD_S, says=SAYS, heal=hands.let_go)


Lie = Callable[[Pose, float], Pose]


def _lying(make: Callable[[Stage, Pose], Lie]) -> Act:
    """From now on the stand-in tells what a lie makes of the true pose."""

    def inject(stage: Stage) -> None:
        assert stage.stand_in is not None
        stage.stand_in.lies(make(stage, stage.bench.town.pose))

    return inject


def _told(name: str, what: str, make: Callable[[Stage, Pose], Lie], threshold_s: float) -> Case:
    return Case(
        *(name, what, _lying(make), threshold_s),
        says=f"{SAYS}|jumped|road|picture",
        before=lambda stage: stage.replace_localizer(),
    )


def _drift(ahead: float, left: float) -> Callable[[Stage, Pose], Lie]:
    def make(_: Stage, start: Pose) -> Lie:
        c, s = math.cos(start.heading_rad), math.sin(start.heading_rad)
        x_mps = DRIFT_MPS * (c * ahead - s * left)
        y_mps = DRIFT_MPS * (s * ahead + c * left)
        return lambda p, t: p._replace(x_m=p.x_m + x_mps * t, y_m=p.y_m + y_mps * t)

    return make


def _turn(_: Stage, __: Pose) -> Lie:
    return lambda p, t: p._replace(heading_rad=p.heading_rad + TURN_RADPS * t)


def _beside(pose: Pose, ahead_m: float, left_m: float) -> Pose:
    c, s = math.cos(pose.heading_rad), math.sin(pose.heading_rad)
    x_m, y_m = pose.x_m + c * ahead_m - s * left_m, pose.y_m + s * ahead_m + c * left_m
    return pose._replace(x_m=x_m, y_m=y_m)


def _other_drives(ahead_m: float, left_m: float) -> Callable[[Stage, Pose], Lie]:
    return lambda _, __: lambda p, _t: _beside(p, ahead_m, left_m)


def _other_stands(_: Stage, start: Pose) -> Lie:
    stands = _beside(start, 0.0, 0.08)
    return lambda _p, _t: stands


def _mirrored(stage: Stage, _: Pose) -> Lie:
    width_m = stage.bench.road_map.width_m
    return lambda p, _t: Pose(width_m - p.x_m, p.y_m, math.pi - p.heading_rad)


def _scaled(_: Stage, __: Pose) -> Lie:
    return lambda p, _t: p._replace(x_m=1.1 * p.x_m, y_m=1.1 * p.y_m)


CASES = (
    _frozen("frozen", "the same picture again and again", _same, "overhead pose", "HOLD"),
    _frozen("flickering", "the same, but for one pixel", _flickering, "overhead pose", "HOLD"),
    _frozen("frozen with noise", "the same, with fresh noise", _noisy, SAYS, "FAULT"),
    _held("held fast", "a hand holds the robot, its wheels slip", Hands()),
    _held("lifted", "a hand lifts it 2 cm aside, its wheels turn freely", Hands(aside_m=0.02)),
    _held("blocked", "it can turn, but not go on", Hands(turns=True)),
    _told("drift ahead", "poses drift by 3 cm/s", _drift(1.0, 0.0), DRIFTED_S),
    _told("drift back", "poses drift by 3 cm/s", _drift(-1.0, 0.0), DRIFTED_S),
    _told("drift left", "poses drift by 3 cm/s", _drift(0.0, 1.0), DRIFTED_S),
    _told("drift right", "poses drift by 3 cm/s", _drift(0.0, -1.0), DRIFTED_S),
    _told("headings turn", "by 3 degrees a second", _turn, TURNED_S),
    _told("swapped", "the other, 8 cm to the left, stands", _other_stands, SWAPPED_S),
    _told("swapped beside", "it drives along", _other_drives(0.0, 0.08), SWAPPED_S),
    _told("swapped ahead", "it drives along", _other_drives(0.08, 0.0), SWAPPED_S),
    _told("poses mirrored", "poses of a mirrored map", _mirrored, SWAPPED_S),
    _told("poses scaled", "poses of a map that is 10 % larger", _scaled, SWAPPED_S),
)
