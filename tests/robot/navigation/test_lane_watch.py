"""A robot that keeps its lane stands before what its pictures show, and goes on when it is gone."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Callable, Optional

import numpy as np
import pytest

from robot.camera.source import Frame
from robot.contract import CONTROL_DT_S, ImageSpec
from robot.errors import ContractError
from robot.geometry import Pose
from robot.inference.preprocess import FRAME_SHAPE
from robot.link.messages import Telemetry
from robot.navigation.road_watch import LaneWatch
from robot.runtime.reports import Reporter
from robot.safety.gates import Reason, SafetyLimits
from robot.safety.governors import Rules
from robot.safety.state_machine import State
from robot.vision.sight import Glimpse, Seen, SightContract
from tests.robot.navigation.test_way_seen import picture
from tests.robot.runtime.test_loop import Bench
from tests.robot.tiny_onnx import lane_contract


class FakeSight:
    """Sees what ``sees`` says; objects to pictures of a wrong size, and to one seen before."""

    contract, path = SightContract(ImageSpec(80, 60, 20)), Path("sight.onnx")

    def __init__(self, sees: Callable[[], Seen]) -> None:
        self.sees = sees
        self._last: Optional[np.ndarray] = None

    def __call__(self, pictures: np.ndarray) -> Seen:
        assert (pictures.shape, pictures.dtype) == ((1, 40, 80, 3), np.uint8)
        assert self._last is None or not np.array_equal(pictures, self._last), "asked twice"
        self._last = pictures
        return self.sees()


class OnTheLane:
    """A whole robot on a straight lane, whose wheels roll as told, and a thing before its nose."""

    def __init__(self, thing_m: float = math.inf) -> None:
        self.thing_m, self.rolled_m = thing_m, 0.0  # from where the robot began
        self.sight = FakeSight(self.see)
        self.bench = Bench(lane_contract(), rules=Rules(headway=True).chain())
        glimpse = Glimpse(self.sight, self.bench.camera.read)  # type: ignore[arg-type]
        self.watch = LaneWatch(glimpse, lambda: Pose(self.rolled_m, 0.0, 0.0))
        self.bench.navigator.look = self.watch.look  # type: ignore[method-assign]

    @property
    def left_m(self) -> float:
        return self.thing_m - self.rolled_m

    def see(self) -> Seen:
        return picture(float(self.left_m < 0.5), min(self.left_m, 0.5))

    def turn(self, count: int = 1) -> OnTheLane:
        for _ in range(count):
            self.bench.turn()
            self.rolled_m += CONTROL_DT_S * self.bench.motors.wheels[0]
        return self

    def drive(self) -> OnTheLane:
        self.bench.drive()
        self.rolled_m += 0.3
        return self.turn(5)


def test_it_stops_before_a_duck_that_appears_25_cm_ahead_at_full_speed() -> None:
    lane = OnTheLane().drive()
    assert lane.bench.motors.wheels == pytest.approx((0.3, 0.3))
    lane.thing_m = lane.rolled_m + 0.25 - 0.03  # from the nose to the duck's middle, and its half
    lane.turn(25)
    assert not lane.bench.motors.turning
    assert 0.06 < lane.left_m < 0.12
    assert lane.bench.state is State.AUTO, "a rule holds it; it is not disarmed"
    stood_m = lane.left_m
    assert lane.turn(100).left_m == stood_m, "it does not creep"


def test_it_goes_on_by_itself_when_three_pictures_show_nothing() -> None:
    lane = OnTheLane().drive()
    lane.thing_m = lane.rolled_m + 0.2
    lane.turn(25)
    assert not lane.bench.motors.turning
    lane.thing_m = math.inf
    lane.turn(2)
    assert not lane.bench.motors.turning
    lane.turn()
    assert lane.bench.motors.turning


def test_the_monitor_is_told_why_it_waits() -> None:
    lane = OnTheLane().drive()
    lane.thing_m = lane.rolled_m + 0.08
    lane.turn(2)
    reporter = Reporter(None, None, Telemetry("robot", "DISARMED"), SafetyLimits())
    reporter.on_tick(lane.bench.heard.ticks[-1])
    assert reporter.newest is not None
    assert (reporter.newest.state, reporter.newest.pose) == ("AUTO", None)
    assert reporter.newest.reason == "something is 8 cm ahead"


def raises() -> Seen:
    raise ContractError("expected finite figures, got others")


FAULTS = {
    "sight fails": Reason.NAVIGATOR,
    "sight is slow": Reason.LOOP_LATE,
    "pictures are old": Reason.FRAME_STALE,
}


@pytest.mark.parametrize("name", FAULTS)
def test_whatever_is_wrong_with_sight_stops_the_motors_in_the_same_turn(name: str) -> None:
    lane = OnTheLane().drive()
    bench = lane.bench

    def slow() -> Seen:
        bench.clock.now_s += 0.35
        return lane.see()

    if name == "sight fails":
        lane.sight.sees = raises
    elif name == "sight is slow":
        lane.sight.sees = slow
    else:
        bench.camera.broken = lambda frame: frame._replace(time_s=frame.time_s - 0.3)
    bench.turn()
    assert not bench.motors.turning
    assert (bench.state, bench.safety.verdict.reason) == (State.FAULT, FAULTS[name])
    lane.sight.sees, bench.camera.broken = lane.see, None
    bench.turn(20)
    assert bench.state is State.FAULT, "only a person ends a fault"


@pytest.mark.parametrize("thing", [math.nan, 0.9])
def test_no_number_is_no_free_way(thing: float) -> None:
    lane = OnTheLane().drive()
    lane.sight.sees = lambda: picture(thing, math.nan)
    lane.turn()
    assert not lane.bench.motors.turning


def test_pictures_are_believed_for_half_a_second() -> None:
    lane = OnTheLane(2.0)
    frame = Frame(np.zeros(FRAME_SHAPE, np.uint8), 1, 7.0)
    lane.bench.camera.broken = lambda _: frame
    for age_s, knows in ((0.0, True), (0.5, True), (0.51, False)):
        free_m = lane.watch.look(frame.time_s + age_s).ahead.free_m
        assert (free_m == math.inf) is knows
        assert math.isnan(free_m) is not knows


def test_what_was_seen_comes_nearer_by_the_wheels_steps_in_bends_too() -> None:
    lane = OnTheLane(0.4)
    pose = Pose(0.0, 0.0, 0.0)
    frame = Frame(np.zeros(FRAME_SHAPE, np.uint8), 1, 7.0)
    watch = LaneWatch(Glimpse(lane.sight, lambda: frame), lambda: pose)  # type: ignore[arg-type]
    assert watch.look(frame.time_s).ahead.free_m == pytest.approx(0.4)
    for _ in range(10):
        pose = pose.moved(0.02, 0.2)
    told = watch.look(frame.time_s + 0.1)
    assert told.driven_m == pytest.approx(0.2, abs=0.04)
