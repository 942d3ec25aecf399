from __future__ import annotations

import logging
import math
import threading
import time
from dataclasses import replace
from typing import Any, Callable, Dict, List, Optional, Sequence, Tuple

import numpy as np
import pytest
from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, invariant, rule

from robot.camera.source import Frame
from robot.computer.clock import MonotonicClock
from robot.contract import ACTION_WHEELS, CONTROL_DT_S, MAX_WHEEL_MPS, Action, PolicyContract
from robot.errors import ContractError, HardwareError
from robot.geometry import STILL, Pose, WheelSpeeds
from robot.inference.preprocess import FRAME_SHAPE
from robot.parts import Guidance
from robot.runtime.loop import Runtime
from robot.runtime.timing import Watchdog
from robot.safety.gates import Reason, SafetyLimits
from robot.safety.governors import Rule
from robot.safety.state_machine import MOVING, Command, Safety, State
from robot.vision.plausibility import Sight
from tests.robot.clocks import FakeClock
from tests.robot.fakes import (
    FakeCamera,
    FakeEyes,
    FakeMotors,
    FakeNavigator,
    FakeOperator,
    FakePolicy,
    FakeSubscriber,
    after,
)
from tests.robot.tiny_onnx import lane_contract, navigation_contract


class Bench:
    """A whole robot of fakes."""

    def __init__(
        self,
        contract: Optional[PolicyContract] = None,
        limits: Optional[SafetyLimits] = None,
        rules: Sequence[Rule] = (),
    ) -> None:
        self.clock = FakeClock()
        self.safety = Safety(self.clock, limits)
        self.camera = FakeCamera(self.clock)
        self.policy = FakePolicy(self.clock, contract or navigation_contract())
        self.motors = FakeMotors(lambda: self.safety.verdict.state in MOVING)
        self.operator, self.navigator = FakeOperator(), FakeNavigator()
        self.eyes = FakeEyes()
        self.heard, self.also_heard = FakeSubscriber(), FakeSubscriber()
        self.runtime = Runtime(
            self.camera,
            self.policy,
            self.motors,
            self.safety,
            self.clock,
            (self.heard, self.also_heard),
            (self.operator,),
            self.navigator,
            self.eyes,
            rules,
        )

    def turn(self, count: int = 1) -> None:
        for _ in range(count):
            began_s = self.clock.now_s
            self.runtime.step()
            self.clock.now_s = max(began_s + CONTROL_DT_S, self.clock.now_s)
            assert not self.motors.objections + self.policy.objections

    def drive(self) -> "Bench":
        """Armed and driving by the policy."""
        self.turn()
        for command in (Command.ARM, Command.AUTO):
            answer = self.runtime.ask(command)
            assert answer.accepted, answer.sentence
        self.turn(3)
        assert self.motors.turning
        return self

    @property
    def state(self) -> State:
        return self.safety.verdict.state


def test_boots_disarmed_with_its_coils_off() -> None:
    bench = Bench()
    bench.turn(5)
    assert bench.state is State.DISARMED
    assert bench.motors.log == ["stop", "release"]
    assert len(bench.heard.ticks) == 5


def test_drives_what_the_policy_prefers() -> None:
    bench = Bench().drive()
    for action in Action:
        bench.policy.best = int(action)
        bench.turn()
        assert bench.motors.wheels == pytest.approx(ACTION_WHEELS[action])
        tick = bench.heard.ticks[-1]
        assert (tick.action, tick.wheels) == (action, bench.motors.wheels)
        assert tick.duration_s == pytest.approx(bench.policy.takes_s)


def test_a_lane_policy_needs_no_navigator_and_a_navigating_one_does() -> None:
    clock = FakeClock()
    parts = (FakeMotors(lambda: True), Safety(clock), clock)
    runtime = Runtime(FakeCamera(clock), FakePolicy(clock, lane_contract()), *parts)
    assert runtime.step().action == Action.STRAIGHT
    with pytest.raises(ContractError, match="got a navigation policy"):
        Runtime(FakeCamera(clock), FakePolicy(clock, navigation_contract()), *parts)


def test_the_policy_is_told_what_the_wheels_were_last_told_the_oldest_first() -> None:
    bench = Bench(lane_contract(commands=5), SafetyLimits(max_wheel_mps=0.15)).drive()
    sent = [tick.wheels for tick in bench.heard.ticks]
    for action in (Action.LEFT, Action.RIGHT, Action.SLIGHT_LEFT, Action.STRAIGHT):
        bench.policy.best = int(action)
        bench.turn()
        last = [share for wheels in [(0.0, 0.0)] * 5 + sent for share in wheels][-10:]
        assert bench.policy.told[-1] == pytest.approx([each / 0.3459 for each in last], abs=1e-6)
        assert bench.heard.ticks[-1].commands == pytest.approx(bench.policy.told[-1])
        sent.append(bench.heard.ticks[-1].wheels)
    assert max(map(abs, bench.policy.told[-1])) == pytest.approx(0.15 / 0.3459)
    bench.operator.wishes.append((Command.MANUAL, WheelSpeeds(-0.1, 0.15)))
    bench.turn(2)
    by_hand = (-0.1 / 0.3459, 0.15 / 0.3459)
    assert bench.policy.told[-1][-2:] == pytest.approx(by_hand, abs=1e-6)
    bench.operator.wishes.append((Command.STOP, None))
    bench.turn(2)
    assert bench.policy.told[-1][-4:] == pytest.approx((*by_hand, 0.0, 0.0), abs=1e-6)
    bench.turn(4)
    assert bench.policy.told[-1] == (0.0,) * 10
    assert Bench().drive().policy.told[-1] == (0.0,) * 10, "a path alone"


def test_a_path_comes_before_the_last_commands() -> None:
    bench = Bench(navigation_contract(commands=5))
    bench.navigator.guidance = Guidance(np.full(10, 0.25, np.float32), pose_age_s=0.1)
    bench.drive()
    assert bench.policy.told[-1][:10] == (0.25,) * 10
    assert bench.policy.told[-1][-2:] == pytest.approx((0.3 / 0.3459,) * 2)


def test_a_speed_cap_slows_both_wheels_alike() -> None:
    bench = Bench(limits=SafetyLimits(max_wheel_mps=0.1)).drive()
    bench.policy.best = int(Action.LEFT)
    bench.turn(2)
    left, right = bench.motors.wheels
    assert right == pytest.approx(0.1)
    assert left / right == pytest.approx(ACTION_WHEELS[0].left_mps / ACTION_WHEELS[0].right_mps)


Fault = Callable[[Bench], None]


def breaks(part: str, error: Exception) -> Fault:
    def happen(bench: Bench) -> None:
        getattr(bench, part).broken = error

    return happen


def frames(change: Callable[[Frame], Any]) -> Fault:
    def happen(bench: Bench) -> None:
        bench.camera.broken = change

    return happen


def values(change: Callable[[np.ndarray], Any]) -> Fault:
    def happen(bench: Bench) -> None:
        bench.policy.broken = change

    return happen


def guidance(**changes: Any) -> Fault:
    def happen(bench: Bench) -> None:
        bench.navigator.guidance = bench.navigator.guidance._replace(**changes)

    return happen


def raises(error: BaseException) -> Callable[..., Any]:
    def part(*_arguments: object) -> None:
        raise error

    return part


def clock_jumps(by_s: float) -> Fault:
    def happen(bench: Bench) -> None:
        bench.clock.now_s += by_s

    return happen


def motors_fail(*names: str) -> Fault:
    def happen(bench: Bench) -> None:
        bench.motors.broken = names

    return happen


def silence(bench: Bench) -> None:
    bench.operator.silent_s = 1.2


def slow_policy(bench: Bench) -> None:
    bench.policy.takes_s = 0.3


FAULTS: Dict[str, Tuple[Reason, Fault]] = {
    "camera raises": (Reason.CAMERA, frames(raises(HardwareError("no child")))),
    "camera gives nothing": (Reason.FRAME_STALE, frames(lambda frame: None)),
    "camera gives old frames": (
        Reason.FRAME_STALE,
        frames(lambda frame: frame._replace(time_s=frame.time_s - 0.3)),
    ),
    "camera dates a frame NaN": (
        Reason.CAMERA,
        frames(lambda frame: frame._replace(time_s=math.nan)),
    ),
    "camera dates a frame ahead": (
        Reason.FRAME_STALE,
        frames(lambda frame: frame._replace(time_s=frame.time_s + 9.0)),
    ),
    "camera gives a wrong size": (
        Reason.CAMERA,
        frames(lambda frame: frame._replace(image=frame.image[:-1])),
    ),
    "camera gives floats": (
        Reason.CAMERA,
        frames(lambda frame: frame._replace(image=frame.image / 255.0)),
    ),
    "camera gives junk": (Reason.CAMERA, frames(lambda frame: "junk")),
    "eyes raise": (Reason.CAMERA, breaks("eyes", ValueError("no fit"))),
    "policy gives NaN": (Reason.NON_FINITE, values(lambda values: values * math.nan)),
    "policy gives infinity": (Reason.NON_FINITE, values(lambda values: values + math.inf)),
    "policy gives one NaN": (
        Reason.NON_FINITE,
        values(lambda values: np.where(values == 1.0, math.nan, values)),
    ),
    "policy gives six values": (Reason.POLICY, values(lambda values: np.ones((1, 6)))),
    "policy gives a column": (Reason.POLICY, values(lambda values: values.T)),
    "policy gives nothing": (Reason.POLICY, values(lambda values: None)),
    "policy raises": (Reason.POLICY, values(raises(RuntimeError("onnxruntime")))),
    "policy is slow": (Reason.LOOP_LATE, slow_policy),
    "operator raises": (Reason.OPERATOR, breaks("operator", ContractError("garbage"))),
    "operator is silent": (Reason.LINK_LOST, silence),
    "navigator raises": (Reason.NAVIGATOR, breaks("navigator", KeyError("lane"))),
    "pose is old": (Reason.POSE_STALE, guidance(pose_age_s=1.1)),
    "pose is NaN old": (Reason.POSE_STALE, guidance(pose_age_s=math.nan)),
    "pose is unsure": (Reason.POSE_UNSURE, guidance(pose_within=(0.081, 0.1))),
    "heading is unsure": (Reason.POSE_UNSURE, guidance(pose_within=(0.02, 0.36))),
    "certainty is NaN": (Reason.POSE_UNSURE, guidance(pose_within=(math.nan, 0.1))),
    "pose jumps": (Reason.POSE_JUMP, guidance(pose_jump=True)),
    "poses drift": (Reason.POSE_DOUBT, guidance(pose_doubt=True)),
    "it is held": (Reason.NOT_MOVING, guidance(not_moving=True)),
    "two localizers": (Reason.DUPLICATE_PUBLISHER, guidance(duplicate_publisher=True)),
    "off the path": (Reason.OFF_PATH, guidance(off_path=True)),
    "off the map": (Reason.OFF_MAP, guidance(off_map=True)),
    "arrived": (Reason.ARRIVED, guidance(arrived=True)),
    "mission gone": (Reason.NO_MISSION, guidance(path=None)),
    "subscriber raises": (Reason.SUBSCRIBER, breaks("heard", OSError("disk full"))),
    "second subscriber raises": (Reason.SUBSCRIBER, breaks("also_heard", OSError("disk full"))),
    "motors raise": (Reason.MOTORS, motors_fail("set_wheels")),
    "clock jumps ahead": (Reason.LOOP_LATE, clock_jumps(0.3)),
    "clock jumps back": (Reason.LOOP_LATE, clock_jumps(-5.0)),
}


@pytest.mark.parametrize("name", FAULTS)
def test_the_motors_stop_within_the_turn_and_nothing_resumes(name: str) -> None:
    bench = Bench().drive()
    reason, happen = FAULTS[name]
    happen(bench)
    bench.turn()
    assert not bench.motors.turning, "stopped by the end of the same turn"
    assert bench.state in (State.HOLD, State.FAULT)
    assert bench.motors.energised is (bench.state is State.HOLD)
    verdict = bench.safety.verdict
    assert verdict.reason is reason
    assert verdict.sentence
    heal(bench)
    bench.turn(30)
    assert bench.heard.ticks[-1].wheels == STILL
    assert bench.safety.verdict == verdict, "the cause is gone, and still nothing resumes"
    assert not bench.motors.turning
    again(bench)


def test_a_pose_that_is_sure_needs_no_overhead_pose() -> None:
    bench = Bench().drive()
    guidance(pose_within=(0.079, 0.34), pose_age_s=math.inf)(bench)
    bench.turn(5)
    assert bench.state is State.AUTO
    lost_s = bench.clock.now()
    guidance(pose_within=(0.2, 0.1))(bench)
    while bench.motors.turning:
        bench.turn()
    assert bench.clock.now() - lost_s <= 0.25


def heal(bench: Bench) -> None:
    bench.camera.broken = bench.policy.broken = bench.operator.broken = None
    bench.eyes.broken = bench.navigator.broken = bench.heard.broken = bench.also_heard.broken = None
    bench.motors.broken = ()
    bench.policy.takes_s, bench.operator.silent_s = 0.01, 0.1
    bench.navigator.guidance = FakeNavigator().guidance


def again(bench: Bench) -> None:
    """A person clears the fault, arms, and the robot drives as before."""
    if bench.state is State.FAULT:
        assert not bench.runtime.ask(Command.ARM).accepted
        assert bench.runtime.ask(Command.CLEAR).accepted
    bench.drive()


def test_a_picture_that_freezes_while_driving_stops_the_robot() -> None:
    bench = Bench().drive()
    still = np.full(FRAME_SHAPE, 7, np.uint8)
    bench.camera.broken = lambda frame: frame._replace(image=still)
    turns = 0
    while bench.motors.turning and turns < 20:
        bench.turn()
        turns += 1
    assert turns == SafetyLimits().frozen_frames + 1
    assert bench.safety.verdict.reason is Reason.FRAME_FROZEN


@pytest.mark.parametrize(
    ("sight", "reason"),
    [
        (Sight(blind_s=0.51), Reason.PICTURE_BLIND),
        (Sight(still_s=1.31), Reason.PICTURE_STILL),
        (Sight(wrong="the picture is upside down"), Reason.PICTURE_WRONG),
    ],
)
def test_a_doubt_of_the_eyes_stops_the_policy_and_nothing_resumes(
    sight: Sight, reason: Reason
) -> None:
    bench = Bench().drive()
    bench.eyes.sight = sight
    bench.turn()
    assert not bench.motors.turning
    assert (bench.state, bench.safety.verdict.reason) == (State.FAULT, reason)
    bench.eyes.sight = Sight()
    bench.turn(20)
    assert bench.state is State.FAULT


def test_a_person_who_drives_by_hand_sees_for_the_robot() -> None:
    bench = Bench()
    bench.turn()
    bench.eyes.sight = Sight(blind_s=9.0, still_s=9.0, wrong="mirrored")
    bench.turn()
    assert bench.runtime.ask(Command.ARM).accepted
    assert not bench.runtime.ask(Command.AUTO).accepted
    assert bench.runtime.ask(Command.MANUAL, WheelSpeeds(0.1, 0.1)).accepted
    bench.turn()
    assert bench.state is State.MANUAL


def test_the_eyes_are_shown_the_frame_the_pose_and_the_wheels() -> None:
    bench = Bench().drive()
    pose = Pose(1.0, 2.0, 0.5)
    bench.navigator.guidance = bench.navigator.guidance._replace(pose=pose)
    bench.turn()
    before = bench.runtime.step()
    tick = bench.runtime.step()
    frame, seen, wheels, now_s = bench.eyes.shown[-1]
    assert frame is tick.frame
    assert (seen, wheels) == (pose, before.wheels)
    assert tick.time_s <= now_s <= tick.time_s + tick.duration_s


def test_a_picture_may_stay_the_same_while_standing() -> None:
    bench = Bench()
    still = np.full(FRAME_SHAPE, 7, np.uint8)
    bench.camera.broken = lambda frame: frame._replace(image=still)
    bench.turn(20)
    assert bench.runtime.ask(Command.ARM).accepted
    bench.turn(20)
    assert bench.state is State.READY


def test_the_same_frame_again_is_not_a_frozen_camera() -> None:
    bench = Bench().drive()
    frame = bench.camera.read()
    assert frame is not None
    bench.camera.broken = lambda new: frame._replace(time_s=new.time_s)
    bench.turn(20)
    assert bench.state is State.AUTO


def test_a_failing_stop_is_tried_again_in_every_turn() -> None:
    bench = Bench().drive()
    bench.motors.broken = ("set_wheels", "stop", "release")
    bench.turn(3)
    assert bench.state is State.FAULT
    assert bench.motors.log.count("stop") >= 3
    assert bench.motors.log.count("release") >= 3
    bench.motors.broken = ()
    bench.turn()
    assert (bench.motors.turning, bench.motors.energised) == (False, False)
    bench.motors.log.clear()
    bench.turn(5)
    assert bench.motors.log == []


@pytest.mark.parametrize("let_go", [Command.DISARM, None])
def test_coils_that_stay_on_are_let_go_again_in_every_turn(let_go: Optional[Command]) -> None:
    bench = Bench().drive()
    bench.motors.broken = ("release",) if let_go else ("release", "set_wheels")
    if let_go:
        bench.runtime.ask(let_go)
    bench.turn(3)
    assert bench.state is State.FAULT
    assert bench.motors.log.count("release") >= 4
    bench.motors.broken = ()
    bench.turn()
    assert not bench.motors.energised


def test_a_failing_stop_is_tried_again_also_where_the_gates_cannot_be_looked_at(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    bench = Bench().drive()
    bench.motors.broken = ("set_wheels", "stop", "release")
    bench.turn()
    monkeypatch.setattr(bench.safety, "check", raises(ValueError("a bug")))
    bench.motors.broken = ()
    bench.turn()
    assert (bench.motors.turning, bench.motors.energised) == (False, False)


def test_who_keeps_its_lane_stops_as_well_when_nobody_is_heard() -> None:
    bench = Bench(lane_contract())
    guidance(path=None)(bench)
    bench.drive()
    silence(bench)
    bench.turn()
    assert (bench.state, bench.safety.verdict.reason) == (State.HOLD, Reason.LINK_LOST)


def test_a_stop_that_fails_in_hold_becomes_a_fault_and_lets_the_coils_go() -> None:
    bench = Bench().drive()
    bench.motors.broken = ("stop",)
    assert bench.runtime.ask(Command.STOP).accepted
    assert bench.state is State.FAULT
    assert not bench.motors.energised


@pytest.mark.parametrize("command", [Command.STOP, Command.DISARM])
def test_a_person_stops_it_at_once_not_in_the_next_turn(command: Command) -> None:
    bench = Bench().drive()
    assert bench.runtime.ask(command).accepted
    assert not bench.motors.turning


def test_the_operator_is_asked_in_every_turn_and_answered() -> None:
    bench = Bench()
    bench.turn()
    bench.operator.wishes = [(Command.AUTO, None), (Command.ARM, None), (Command.AUTO, None)]
    bench.turn()
    assert [answer.accepted for answer in bench.operator.answers] == [False, True, True]
    assert bench.motors.turning


def test_without_a_mission_the_wish_to_drive_turns_no_wheel() -> None:
    bench = Bench()
    bench.navigator.guidance = bench.navigator.guidance._replace(path=None)
    bench.turn()
    bench.operator.wishes = [(Command.ARM, None), (Command.AUTO, None)]
    bench.turn()
    assert (bench.state, bench.safety.verdict.reason) == (State.HOLD, Reason.NO_MISSION)
    assert "set_wheels" not in bench.motors.log


def test_a_manual_command_holds_a_third_of_a_second_and_no_longer() -> None:
    bench = Bench()
    bench.turn()
    wheels = WheelSpeeds(0.1, -0.1)
    bench.runtime.ask(Command.ARM)
    assert bench.runtime.ask(Command.MANUAL, wheels).accepted
    for _ in range(3):
        bench.turn()
        assert bench.motors.wheels == wheels
    assert bench.runtime.ask(Command.MANUAL).accepted
    bench.turn()
    assert bench.motors.wheels == STILL
    assert bench.state is State.MANUAL
    bench.turn(3)
    assert (bench.state, bench.safety.verdict.reason) == (State.HOLD, Reason.MANUAL_STALE)


def test_manual_speeds_are_limited_and_nonsense_is_a_fault() -> None:
    bench = Bench()
    bench.turn()
    bench.runtime.ask(Command.ARM)
    bench.runtime.ask(Command.MANUAL, WheelSpeeds(9.0, -9.0))
    bench.turn(3)
    assert max(map(abs, bench.motors.wheels)) == pytest.approx(MAX_WHEEL_MPS)
    bench.runtime.ask(Command.MANUAL, WheelSpeeds(math.nan, 0.0))
    bench.turn()
    assert bench.state is State.FAULT
    assert not bench.motors.turning


def test_the_watch_stops_the_motors_while_the_loop_hangs() -> None:
    bench = Bench().drive()

    def hang(frame: Frame) -> Frame:
        bench.clock.now_s += 0.15
        bench.runtime.watch()
        assert bench.motors.turning
        bench.clock.now_s += 0.2
        bench.runtime.watch()
        assert not bench.motors.turning, "stopped although the loop still hangs"
        return frame

    bench.camera.broken = hang
    bench.turn()
    assert bench.safety.verdict.reason is Reason.LOOP_LATE


def test_a_fault_is_cleared_only_when_the_motors_work_again() -> None:
    bench = Bench().drive()
    bench.motors.broken = ("set_wheels", "mend")
    bench.turn()
    assert bench.safety.verdict.reason is Reason.MOTORS
    answer = bench.runtime.ask(Command.CLEAR)
    assert not answer.accepted
    assert "the bus does not answer" in answer.sentence
    assert bench.state is State.FAULT
    bench.motors.broken = ()
    assert bench.runtime.ask(Command.CLEAR).accepted
    assert bench.state is State.DISARMED
    bench.drive()


def test_the_real_watchdog_stops_a_hanging_loop() -> None:
    clock = MonotonicClock()
    safety = Safety(clock.now, SafetyLimits(frame_age_s=9.0))
    fake = FakeClock()
    camera, motors = FakeCamera(fake), FakeMotors(lambda: safety.verdict.state in MOVING)
    runtime = Runtime(camera, FakePolicy(fake), motors, safety, clock)

    def step() -> None:
        fake.now_s = clock.now() + 0.02
        runtime.step()

    step()
    runtime.ask(Command.ARM)
    runtime.ask(Command.AUTO)
    step()
    assert motors.turning
    with Watchdog(runtime.watch):
        began_s = time.monotonic()
        while motors.turning:
            assert time.monotonic() - began_s < 3.0
            time.sleep(0.01)
    assert safety.verdict.reason is Reason.LOOP_LATE
    assert threading.active_count() == 1 or all(t.name != "watchdog" for t in threading.enumerate())


def test_running_keeps_time_and_ends_disarmed() -> None:
    bench = Bench()
    began_s = bench.clock.now_s
    bench.runtime.run(after(21))
    assert bench.clock.now_s - began_s == pytest.approx(20 * CONTROL_DT_S + bench.policy.takes_s)
    bench.drive()
    bench.runtime.run(ending=lambda: len(bench.heard.ticks) >= 40)
    assert bench.state is State.DISARMED
    assert not bench.motors.energised


def test_an_interrupt_releases_the_motors() -> None:
    bench = Bench().drive()
    bench.camera.broken = raises(KeyboardInterrupt())
    with pytest.raises(KeyboardInterrupt):
        bench.runtime.run(lambda: False)
    assert bench.state is State.DISARMED
    assert not bench.motors.energised


def test_the_lag_is_reported() -> None:
    bench = Bench()
    bench.policy.takes_s = 0.13
    bench.runtime.run(after(4))
    assert [tick.lag_s for tick in bench.heard.ticks] == pytest.approx([0.0, 0.03, 0.06, 0.09])


class AnyLife(RuleBasedStateMachine):
    """Any mixture of faults, healing and wishes; the motors' fake objects to unallowed driving."""

    def __init__(self) -> None:
        super().__init__()
        self.bench = Bench()
        self.wishes: List[Command] = []

    @rule(name=st.sampled_from(sorted(FAULTS)))
    def fault(self, name: str) -> None:
        FAULTS[name][1](self.bench)

    @rule()
    def heal(self) -> None:
        heal(self.bench)

    @rule(count=st.integers(1, 4))
    def turn(self, count: int) -> None:
        self.bench.turn(count)

    @rule()
    def watch(self) -> None:
        self.bench.runtime.watch()

    @rule(command=st.sampled_from(list(Command)))
    def ask(self, command: Command) -> None:
        before = self.bench.state
        answer = self.bench.runtime.ask(command, WheelSpeeds(0.1, 0.2))
        if answer.accepted and self.bench.state is not before:
            self.wishes.append(command)

    @rule()
    def start(self) -> None:
        heal(self.bench)
        self.bench.turn()
        for command in (Command.CLEAR, Command.ARM, Command.AUTO):
            self.ask(command)
        self.bench.turn()

    @invariant()
    def wheels_turn_only_when_allowed(self) -> None:
        assert not self.bench.motors.objections
        if self.bench.motors.turning:
            assert self.bench.state in (State.AUTO, State.MANUAL)
            assert Command.ARM in self.wishes
            assert self.wishes[-1] in (Command.AUTO, Command.MANUAL)


TestAnyLife = AnyLife.TestCase
TestAnyLife.settings = settings(
    max_examples=min(60, settings().max_examples), stateful_step_count=30
)


def test_limits_travel_with_the_safety() -> None:
    bench = Bench(limits=replace(SafetyLimits(), frame_age_s=0.5)).drive()
    bench.camera.broken = lambda frame: frame._replace(time_s=frame.time_s - 0.3)
    bench.turn(3)
    assert bench.state is State.AUTO


def test_the_longest_silence_of_several_operators_counts() -> None:
    bench = Bench()
    second, beside = FakeOperator(), FakeOperator()
    bench.operator.silent_s, second.silent_s, beside.silent_s = 0.2, 0.7, None
    for operators, expected_s in (
        ((bench.operator, second, beside), 0.7),
        ((second, bench.operator), 0.7),
        ((beside,), None),
        ((), None),
    ):
        bench.runtime._operators = operators
        assert bench.runtime.step().inputs.link_age_s == expected_s


def test_the_motors_stop_before_a_fault_is_written_down() -> None:
    """Who writes may wait for a full disk, or for a terminal that a person has paused."""
    bench, seen = Bench().drive(), []

    class Slow(logging.Handler):
        def emit(self, record: logging.LogRecord) -> None:
            seen.append((record.getMessage(), bench.motors.turning))

    def broken(now_s: float) -> Any:
        raise ValueError("no way")

    bench.navigator.look = broken
    logger = logging.getLogger("robot.runtime.loop")
    logger.addHandler(slow := Slow())
    bench.turn()
    logger.removeHandler(slow)
    assert seen == [("fault: navigator: no way", False)]
