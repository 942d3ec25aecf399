"""Poses: none, late, in the wrong order, jumping; and poses and wheels that tell two ways."""

from __future__ import annotations

import dataclasses
import math
import signal
from collections.abc import Callable

import numpy as np

from robot.geometry import Pose, wrap_angle
from sim_pybullet.virtual.world import PHYSICS_DT_S
from tools.faults.case import HOLD, HOLD_OR_FAULT, Act, Case, change
from tools.faults.stage import Stage
from tools.faults.stand_in import Lie, StandIn
from tools.loop.timekeeper import BenchError, Event

POSE_AGE_S = 1.0
OLD = "overhead pose"
FROZEN_S, HELD_S, SWAPPED_S = 1.0, 1.5, 2.0
DRIFT_MPS = 0.03
DRIFTED_S = 2.4  # a quarter of a second later the poses are 8 cm off
BENT_RAD = 0.2  # no robot turns so far on a straight
TURN_RADPS = math.radians(3.0)
TURNED_S = 5.0
WIDTH_M = 2.2  # of the arena
NOISE = 3.0  # of the overhead sensor, grey levels
SAYS = "wheels"


def _ended(name: str, what: str, inject: Act) -> Case:
    return Case(name, what, inject, POSE_AGE_S, OLD, HOLD)


def _stand_in(stage: Stage) -> StandIn:
    assert stage.stand_in is not None  # `Case.before` has put it in place
    return stage.stand_in


def _lying(
    name: str, what: str, inject: Act, threshold_s: float, says: str, states: tuple[str, ...]
) -> Case:
    """The stand-in told true poses until now."""
    return Case(name, what, inject, threshold_s, says, states, before=Stage.replace_localizer)


def _tell(lie: Lie) -> Act:
    return lambda stage: _stand_in(stage).lies(lie)


LATE, BACKWARDS = change(_stand_in, late_s=1.5), change(_stand_in, backwards=True)
BACK, FORWARD = change(_stand_in, clock_step_s=-100.0), change(_stand_in, clock_step_s=100.0)
TWINS = change(_stand_in, twins=True)
LOCALIZER = (
    _ended("killed", "SIGKILL", lambda stage: stage.bench.end("localizer", signal.SIGKILL)),
    _ended("ended", "SIGTERM", lambda stage: stage.bench.end("localizer", signal.SIGTERM)),
    _ended("paused", "SIGSTOP", lambda stage: stage.bench.freeze("localizer")),
    _lying("late", "every pose 1.5 s late", LATE, POSE_AGE_S, OLD, HOLD),
    _lying("out of order", "sequence numbers that fall", BACKWARDS, POSE_AGE_S, OLD, HOLD),
    _lying(
        *(
            "jumping",
            "one metre to the east at once",
            _tell(lambda p, *_: p._replace(x_m=p.x_m + 1.0)),
        ),
        0.6,  # five unbelievable poses in a row
        f"jumped|{OLD}",
        HOLD_OR_FAULT,
    ),
    _lying("doubled", "two sessions take turns", TWINS, 0.4, "two localizers", ("FAULT",)),
    _lying("clock set back", "its clock loses 100 s", BACK, POSE_AGE_S, "", HOLD_OR_FAULT),
    _lying("clock set forward", "its clock gains 100 s", FORWARD, 0.0, "", ()),
)

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


def _frozen(name: str, what: str, again: Again, says: str, state: str) -> Case:
    def freeze(stage: Stage) -> None:
        frozen = stage.bench.town.see_above()
        stage.bench.town.overhead.see = lambda: again(frozen, stage.rng)

    def thaw(stage: Stage) -> None:
        stage.bench.town.overhead.see = stage.bench.town.see_above

    return Case(f"overhead {name}", what, freeze, FROZEN_S, says, (state,), heal=thaw)


def _held(name: str, what: str, turns: bool = False, aside_m: float = 0.0) -> Case:
    """Hands keep a robot where it is, or a little aside, whatever its wheels do."""
    events: list[Event] = []

    def hold(stage: Stage) -> None:
        world = stage.bench.town.world
        x_m, y_m, heading_rad = _beside(world.pose, 0.0, aside_m)

        def keep() -> None:
            world.place(Pose(x_m, y_m, world.pose.heading_rad if turns else heading_rad))

        events.append(stage.bench.time.every(PHYSICS_DT_S, keep))

    def let_go(stage: Stage) -> None:
        while events:
            stage.bench.time.forget(events.pop())

    return Case(name, what, hold, HELD_S, SAYS, heal=let_go)


def _told(name: str, what: str, lie: Lie, threshold_s: float = SWAPPED_S) -> Case:
    says = f"{SAYS}|jumped|road|picture"
    return _lying(name, what, _tell(lie), threshold_s, says, ("FAULT",))


def _beside(pose: Pose, ahead_m: float, left_m: float) -> Pose:
    x_m, y_m = (float(v) for v in pose.to_world(np.array((ahead_m, left_m))))
    return pose._replace(x_m=x_m, y_m=y_m)


def _drift(name: str, ahead: float, left: float) -> Case:
    def lie(pose: Pose, t_s: float, first: Pose) -> Pose:
        way = first._replace(x_m=pose.x_m, y_m=pose.y_m)
        moved = _beside(way, DRIFT_MPS * t_s * ahead, DRIFT_MPS * t_s * left)
        return moved._replace(heading_rad=pose.heading_rad)

    return _told(f"drift {name}", "poses drift by 3 cm/s", lie, DRIFTED_S)


def _in_bend(case: Case) -> Case:
    """The same, beginning where the mission's first bend does."""

    def approach(stage: Stage) -> None:
        def turned_rad() -> float:
            return float(wrap_angle(stage.bench.town.pose.heading_rad - stage.start.heading_rad))

        for _ in range(200):
            if abs(turned_rad()) > BENT_RAD:
                return
            stage.run(0.1)
        raise BenchError("expected a bend within 20 s, the robot drove straight on")

    name, what = f"{case.name} in a bend", f"{case.what}, from the first bend on"
    return dataclasses.replace(case, name=name, what=what, approach=approach)


WAYS = (
    _frozen("frozen", "the same picture again and again", _same, OLD, "HOLD"),
    _frozen("flickering", "the same, but for one pixel", _flickering, OLD, "HOLD"),
    _frozen("frozen with noise", "the same, with fresh noise", _noisy, SAYS, "FAULT"),
    _held("held fast", "a hand holds the robot, its wheels slip"),
    _held("lifted", "a hand lifts it 2 cm aside, its wheels turn freely", aside_m=0.02),
    _held("blocked", "it can turn, but not go on", turns=True),
    _drift("ahead", 1.0, 0.0),
    _drift("back", -1.0, 0.0),
    _drift("left", 0.0, 1.0),
    _drift("right", 0.0, -1.0),
    _in_bend(_drift("ahead", 1.0, 0.0)),
    _in_bend(_drift("left", 0.0, 1.0)),
    _told(
        *("headings turn", "by 3 degrees a second"),
        lambda p, t_s, _: p._replace(heading_rad=p.heading_rad + TURN_RADPS * t_s),
        TURNED_S,
    ),
    _told(
        *("swapped", "the other, 8 cm to the left, stands"),
        lambda _p, _t, first: _beside(first, 0.0, 0.08),
    ),
    _told("swapped beside", "it drives along", lambda p, *_: _beside(p, 0.0, 0.08)),
    _told("swapped ahead", "it drives along", lambda p, *_: _beside(p, 0.08, 0.0)),
    _told(
        *("poses mirrored", "poses of a mirrored map"),
        lambda p, *_: Pose(WIDTH_M - p.x_m, p.y_m, math.pi - p.heading_rad),
    ),
    _told(
        *("poses scaled", "poses of a map that is 10 % larger"),
        lambda p, *_: p._replace(x_m=1.1 * p.x_m, y_m=1.1 * p.y_m),
    ),
)
CASES = {"localizer": LOCALIZER, "ways": WAYS}
