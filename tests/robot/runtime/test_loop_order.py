"""What the loop does in which order, once or anew, and while whom nobody else moves the motors."""

from __future__ import annotations

import logging
import math
import threading
from typing import List, Tuple

import numpy as np
import pytest

from robot.camera.source import Frame
from robot.geometry import STILL, WheelSpeeds
from robot.inference.preprocess import FRAME_SHAPE
from robot.safety.gates import Reason
from robot.safety.governors import Cap, Road, Rules
from robot.safety.road_ahead import RoadAhead
from robot.safety.state_machine import Command, State
from tests.robot.runtime.test_loop import Bench, frames, guidance, raises
from tests.robot.tiny_onnx import navigation_contract

FORWARD, BACKWARD = WheelSpeeds(0.3, 0.3), WheelSpeeds(-0.3, -0.3)


def test_the_coils_are_let_go_also_after_a_hold() -> None:
    for let_go in (lambda bench: bench.runtime.ask(Command.DISARM), frames(raises(OSError()))):
        bench = Bench().drive()
        assert bench.runtime.ask(Command.STOP).accepted
        assert (bench.state, bench.motors.energised) == (State.HOLD, True)
        let_go(bench)
        bench.turn()
        assert bench.state in (State.DISARMED, State.FAULT)
        assert not bench.motors.energised


def test_what_the_wheels_may_change_is_counted_from_what_they_were_told_last() -> None:
    bench = Bench()
    bench.turn(20)
    bench.runtime.ask(Command.ARM)
    bench.runtime.ask(Command.MANUAL, FORWARD)
    bench.turn(2)
    first, second = (tick.drive for tick in bench.heard.ticks[-2:])
    assert first is not None
    assert second is not None
    assert first.dt_s == pytest.approx(0.2), "a long rest counts no more than a late turn"
    assert second.dt_s == pytest.approx(0.1)
    bench.runtime.ask(Command.MANUAL, BACKWARD)
    bench.turn()
    assert bench.motors.wheels == pytest.approx((-0.132, -0.132), abs=1e-3), "4.32 m/s^2 for 0.1 s"
    bench.turn()
    assert bench.motors.wheels == pytest.approx(BACKWARD)


def test_clear_without_a_fault_leaves_the_motors_alone() -> None:
    bench = Bench().drive()
    assert not bench.runtime.ask(Command.CLEAR).accepted
    assert bench.motors.turning
    assert "mend" not in bench.motors.log


@pytest.mark.parametrize("busy", ["set_wheels", "stop"])
def test_the_watch_waits_while_the_loop_or_a_person_tells_the_motors(
    busy: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    bench = Bench().drive()
    tell, watches = getattr(bench.motors, busy), []

    def slow(*wheels: WheelSpeeds) -> None:
        if not watches:
            watches.append(watch := threading.Thread(target=bench.runtime.watch, daemon=True))
            watch.start()
            watch.join(0.1)
            assert watch.is_alive(), "it looked at the safety, and may tell the motors"
        tell(*wheels)

    monkeypatch.setattr(bench.motors, busy, slow)
    bench.turn()
    assert bench.state is State.AUTO
    assert bench.runtime.ask(Command.STOP).accepted
    assert bench.state is State.HOLD
    watches[0].join(5.0)
    assert not watches[0].is_alive()


def test_the_watch_waits_while_a_fault_stops_the_motors(monkeypatch: pytest.MonkeyPatch) -> None:
    bench = Bench().drive()
    stop, waits = bench.motors.stop, []

    def slow() -> None:
        watch = threading.Thread(target=bench.runtime.watch, daemon=True)
        watch.start()
        watch.join(0.1)
        waits.append(watch.is_alive())
        stop()

    monkeypatch.setattr(bench.motors, "stop", slow)
    bench.camera.broken = raises(OSError())
    bench.turn()
    assert bench.state is State.FAULT
    assert waits == [True]


def test_an_operator_who_goes_while_being_served_is_missed_in_the_same_turn() -> None:
    bench = Bench().drive()
    bench.operator.serve = lambda ask: setattr(bench.operator, "silent_s", math.inf)  # type: ignore[method-assign]
    bench.turn()
    assert (bench.state, bench.safety.verdict.reason) == (State.HOLD, Reason.LINK_LOST)


def test_to_arrive_hides_no_fault_of_the_same_turn() -> None:
    bench = Bench().drive()
    guidance(arrived=True)(bench)
    frames(lambda frame: frame._replace(time_s=frame.time_s - 0.3))(bench)
    bench.turn()
    assert (bench.state, bench.safety.verdict.reason) == (State.FAULT, Reason.FRAME_STALE)
    assert not bench.motors.energised


class Listener:
    """A rule of the road that keeps what it was told."""

    def __init__(self) -> None:
        self.roads: List[Road] = []

    def after(self, road: Road) -> Tuple[Listener, Cap]:
        self.roads.append(road)
        return self, Cap()


def test_the_rules_are_told_of_the_faster_wheel_also_backwards() -> None:
    actions = ((-0.2, -0.1), (0.0, 0.1), (0.1, 0.1), (0.1, 0.0), (0.2, 0.1))
    listener = Listener()
    bench = Bench(navigation_contract(actions=actions), rules=(listener,)).drive()
    bench.policy.best = 0
    bench.turn(3)
    assert listener.roads[-1].told_mps == pytest.approx(0.2)


def test_the_rules_are_told_when_and_how_far_it_has_driven_and_what_is_ahead() -> None:
    listener, ahead = Listener(), RoadAhead(line_m=0.7)
    bench = Bench(rules=(listener,)).drive()
    guidance(driven_m=12.5, ahead=ahead)(bench)
    bench.turn()
    road = listener.roads[-1]
    assert (road.driven_m, road.ahead) == (12.5, ahead)
    tick = bench.heard.ticks[-1]
    assert road.now_s == pytest.approx(tick.time_s + tick.duration_s)


def test_the_rules_begin_anew_with_each_drive() -> None:
    bench = Bench(rules=Rules(stop_lines=True).chain()).drive()
    guidance(ahead=RoadAhead(line_m=0.05))(bench)
    bench.turn(18)
    assert bench.motors.turning, "it has stood at this line"
    for command in (Command.STOP, Command.ARM, Command.AUTO):
        assert bench.runtime.ask(command).accepted
        bench.turn(2)
    assert bench.state is State.AUTO
    assert bench.motors.wheels == STILL


def test_only_pictures_that_are_the_same_in_a_row_are_frozen() -> None:
    bench = Bench().drive()

    def twice_each(frame: Frame) -> Frame:
        return frame._replace(image=np.full(FRAME_SHAPE, frame.sequence // 2, np.uint8))

    bench.camera.broken = twice_each
    bench.turn(30)
    assert bench.state is State.AUTO


def test_pictures_that_differ_in_one_place_are_not_frozen() -> None:
    bench = Bench().drive()

    def spot(frame: Frame) -> Frame:
        image = np.zeros(FRAME_SHAPE, np.uint8)
        image[-1, frame.sequence % FRAME_SHAPE[1]] = 255
        return frame._replace(image=image)

    bench.camera.broken = spot
    bench.turn(30)
    assert bench.state is State.AUTO


def test_pictures_that_were_the_same_before_a_rest_do_not_count_after_it() -> None:
    bench = Bench().drive()
    still = np.full(FRAME_SHAPE, 7, np.uint8)
    bench.camera.broken = lambda frame: frame._replace(image=still)
    bench.turn(5)
    assert bench.heard.ticks[-1].inputs.frame_repeats == 4, "one more would be frozen"
    for command in (Command.STOP, Command.ARM, Command.AUTO):
        assert bench.runtime.ask(command).accepted
        bench.turn()
    bench.turn()
    assert (bench.state, bench.heard.ticks[-1].inputs.frame_repeats) == (State.AUTO, 1)


def test_a_fault_that_lasts_is_written_down_once_with_its_kind(
    caplog: pytest.LogCaptureFixture,
) -> None:
    bench = Bench().drive()
    bench.navigator.broken = KeyError()
    with caplog.at_level(logging.ERROR):
        bench.turn(10)
    assert [record.getMessage() for record in caplog.records] == ["fault: navigator: KeyError"]


def test_a_turn_at_rest_asked_nothing_of_the_wheels() -> None:
    bench = Bench().drive()
    assert bench.heard.ticks[-1].drive is not None
    bench.runtime.ask(Command.STOP)
    bench.turn(2)
    assert [tick.drive for tick in bench.heard.ticks[-2:]] == [None, None]


def test_what_the_motors_did_not_take_was_not_driven() -> None:
    bench = Bench().drive()
    bench.motors.broken = ("set_wheels",)
    bench.turn()
    tick = bench.heard.ticks[-1]
    assert (tick.drive, tick.wheels) == (None, STILL)


def test_a_turn_lasts_from_its_own_beginning() -> None:
    bench = Bench()
    began_s = bench.clock.now()
    tick = bench.runtime.step(lag_s=0.5)
    assert (tick.time_s, tick.lag_s) == (began_s, 0.5)
    assert tick.duration_s == pytest.approx(0.01)


def test_the_way_is_that_of_the_turns_own_beginning() -> None:
    bench, asked = Bench().drive(), []
    look = bench.navigator.look
    bench.navigator.look = lambda now_s: asked.append(now_s) or look(now_s)  # type: ignore[method-assign,func-returns-value]
    bench.turn(2)
    assert asked == [tick.time_s for tick in bench.heard.ticks[-2:]]


def test_a_subscriber_that_fails_keeps_no_other_from_hearing_of_it() -> None:
    """The monitor is told after the watchdog and the motors have looked."""
    bench = Bench().drive()
    bench.heard.broken = OSError("disk full")
    bench.turn(2)
    assert bench.also_heard.ticks[-2:] == bench.heard.ticks[-2:]
    assert bench.also_heard.ticks[-1].verdict.reason is Reason.SUBSCRIBER


def test_turns_are_numbered_from_zero_one_by_one() -> None:
    bench = Bench()
    bench.turn(3)
    assert [tick.number for tick in bench.heard.ticks] == [0, 1, 2]
