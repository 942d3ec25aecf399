from __future__ import annotations

import math
from dataclasses import replace
from itertools import product
from typing import Dict, List, Optional, Tuple

import pytest
from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, invariant, precondition, rule

from robot.contract import MAX_WHEEL_MPS
from robot.errors import ConfigError
from robot.safety.gates import Inputs, Reason, SafetyLimits, trips
from robot.safety.state_machine import (
    ALWAYS_TAKEN,
    COMES_WITH_THE_WISH,
    HOLDS,
    MOVING,
    TRANSITIONS,
    WATCHED,
    Command,
    Safety,
    State,
)
from tests.robot.clocks import FakeClock

GOOD = Inputs(frame_age_s=0.03, frame_repeats=1, pose_age_s=0.3, link_age_s=0.2, manual_age_s=0.1)
NAN, INF = math.nan, math.inf
# Every gate, with inputs that trip it alone.
BAD: Dict[Reason, Tuple[Inputs, ...]] = {
    Reason.FRAME_STALE: tuple(replace(GOOD, frame_age_s=age) for age in (0.21, -0.1, NAN, INF)),
    Reason.FRAME_FROZEN: (replace(GOOD, frame_repeats=5),),
    Reason.PICTURE_BLIND: tuple(replace(GOOD, blind_s=age) for age in (0.51, -0.1, NAN, INF)),
    Reason.PICTURE_WRONG: (replace(GOOD, picture_wrong="the picture is upside down"),),
    Reason.PICTURE_STILL: tuple(replace(GOOD, still_s=age) for age in (1.31, -0.1, NAN, INF)),
    Reason.NON_FINITE: (replace(GOOD, values_finite=False),),
    Reason.DUPLICATE_PUBLISHER: (replace(GOOD, duplicate_publisher=True),),
    Reason.POSE_JUMP: (replace(GOOD, pose_jump=True),),
    Reason.POSE_DOUBT: (replace(GOOD, pose_doubt=True),),
    Reason.NOT_MOVING: (replace(GOOD, not_moving=True),),
    Reason.POSE_STALE: tuple(replace(GOOD, pose_age_s=age) for age in (1.01, -0.1, NAN, INF)),
    Reason.POSE_UNSURE: tuple(
        replace(GOOD, pose_within=within)
        for within in ((0.081, 0.1), (0.05, 0.351), (NAN, 0.1), (0.05, NAN), (INF, INF))
    ),
    Reason.NO_MISSION: (replace(GOOD, no_mission=True),),
    Reason.OFF_MAP: (replace(GOOD, off_map=True),),
    Reason.OFF_PATH: (replace(GOOD, off_path=True),),
    Reason.LINK_LOST: tuple(replace(GOOD, link_age_s=age) for age in (1.01, -0.1, NAN, INF)),
    Reason.MANUAL_STALE: tuple(
        replace(GOOD, manual_age_s=age) for age in (0.31, -0.1, NAN, INF, None)
    ),
}
CASES = [(reason, inputs) for reason, many in BAD.items() for inputs in many]


def reached(state: State) -> Tuple[Safety, FakeClock]:
    """A supervisor that got to ``state`` the regular way."""
    clock = FakeClock()
    safety = Safety(clock)
    safety.check(GOOD)
    steps = {
        State.DISARMED: (),
        State.READY: (Command.ARM,),
        State.AUTO: (Command.ARM, Command.AUTO),
        State.MANUAL: (Command.ARM, Command.MANUAL),
        State.HOLD: (Command.ARM, Command.STOP),
        State.FAULT: (),
    }[state]
    for command in steps:
        assert safety.command(command).accepted
    if state is State.FAULT:
        safety.fault(Reason.CAMERA, "unplugged")
    assert safety.verdict.state is state
    return safety, clock


def test_boots_disarmed_and_stays_so() -> None:
    clock = FakeClock()
    safety = Safety(clock)
    assert safety.verdict.state is State.DISARMED
    for _ in range(100):
        clock.now_s += 0.1
        assert safety.check(GOOD).state not in MOVING


def test_nothing_arms_before_the_loop_has_run() -> None:
    answer = Safety(FakeClock()).command(Command.ARM)
    assert not answer.accepted
    assert "has not run" in answer.sentence


@pytest.mark.parametrize(("state", "command"), list(product(State, Command)))
def test_commands_lead_where_the_table_says(state: State, command: Command) -> None:
    safety, _ = reached(state)
    answer = safety.command(command)
    target = TRANSITIONS.get((state, command))
    assert safety.verdict.state is (target or state)
    if target is None and command not in ALWAYS_TAKEN and command.value != state.value.lower():
        assert not answer.accepted
        for (source, possible), _target in TRANSITIONS.items():
            assert (possible.value in answer.sentence.split("possible:")[1]) or source != state
    else:
        assert answer.accepted


@pytest.mark.parametrize("state", State)
def test_stop_and_disarm_end_motion_from_everywhere(state: State) -> None:
    for command in ALWAYS_TAKEN:
        safety, _ = reached(state)
        assert safety.command(command).accepted
        assert safety.verdict.state not in MOVING


@pytest.mark.parametrize(("reason", "inputs"), CASES)
@pytest.mark.parametrize("state", State)
def test_each_gate_acts_in_the_states_that_depend_on_it(
    state: State, reason: Reason, inputs: Inputs
) -> None:
    assert [trip.reason for trip in trips(inputs, 0.1, SafetyLimits())] == [reason]
    safety, clock = reached(state)
    clock.now_s += 0.1
    verdict = safety.check(inputs)
    if reason in WATCHED.get(state, ()):
        assert verdict.state is (State.HOLD if reason in HOLDS else State.FAULT)
        assert verdict.reason is reason
        assert verdict.sentence
        clock.now_s += 0.1
        assert safety.check(GOOD) == verdict, "nothing resumes by itself"
    else:
        assert verdict.state is state


@pytest.mark.parametrize(("reason", "inputs"), CASES)
@pytest.mark.parametrize("command", [Command.ARM, Command.AUTO, Command.MANUAL])
def test_a_command_towards_motion_is_refused_while_a_gate_is_shut(
    command: Command, reason: Reason, inputs: Inputs
) -> None:
    source = State.DISARMED if command is Command.ARM else State.READY
    target = TRANSITIONS[(source, command)]
    safety, _ = reached(source)
    safety.check(inputs)
    if safety.verdict.state is not source:
        return  # READY has fallen already
    answer = safety.command(command)
    shut = reason in WATCHED[target] - COMES_WITH_THE_WISH
    assert answer.accepted is not shut
    assert not shut or "is refused: " in answer.sentence


@pytest.mark.parametrize("state", [State.READY, *sorted(MOVING, key=lambda s: s.value)])
@pytest.mark.parametrize("gap_s", [0.21, 5.0, -0.1])
def test_a_late_loop_or_a_jumping_clock_is_a_fault(state: State, gap_s: float) -> None:
    safety, clock = reached(state)
    clock.now_s += gap_s
    assert safety.check(GOOD).reason is Reason.LOOP_LATE
    other, clock = reached(state)
    clock.now_s += gap_s
    assert other.watch().state is State.FAULT


def test_the_watch_looks_at_the_loop_and_at_what_grows_old_meanwhile() -> None:
    safety, clock = reached(State.AUTO)
    clock.now_s += 0.15
    assert safety.watch().state is State.AUTO
    clock.now_s += 0.15
    assert safety.watch().reason is Reason.LOOP_LATE
    for reason, field in ((Reason.POSE_STALE, "pose_age_s"), (Reason.LINK_LOST, "link_age_s")):
        safety, clock = reached(State.AUTO)
        safety.check(replace(GOOD, **{field: 0.97}))
        assert safety.watch().state is State.AUTO
        clock.now_s += 0.05
        assert safety.watch().reason is reason
        assert safety.verdict.state is State.HOLD
    safety, clock = reached(State.AUTO)
    safety.check(replace(GOOD, frame_age_s=0.17))
    clock.now_s += 0.05
    assert safety.watch().state is State.AUTO, "a newer frame may have come"


@pytest.mark.parametrize(
    ("reason", "inputs"),
    [case for case in CASES if case[0] not in WATCHED[State.MANUAL] | COMES_WITH_THE_WISH],
)
def test_who_drives_by_hand_hands_over_only_while_every_gate_of_the_policy_holds(
    reason: Reason, inputs: Inputs
) -> None:
    safety, _ = reached(State.MANUAL)
    assert safety.check(inputs).state is State.MANUAL, reason
    answer = safety.command(Command.AUTO)
    assert (answer.accepted, safety.verdict.state) == (False, State.MANUAL)
    assert answer.sentence.startswith("auto is refused: ")
    safety.check(GOOD)
    assert safety.command(Command.AUTO).accepted


def test_arming_is_refused_when_the_loop_hangs() -> None:
    safety, clock = reached(State.DISARMED)
    clock.now_s += 1.0
    assert not safety.command(Command.ARM).accepted


def test_the_gravest_trip_decides_and_the_first_fault_is_kept() -> None:
    safety, _ = reached(State.AUTO)
    verdict = safety.check(replace(GOOD, off_path=True, values_finite=False, link_age_s=INF))
    assert verdict.reason is Reason.NON_FINITE
    assert safety.fault(Reason.MOTORS, "later") == verdict


def test_arriving_holds_and_only_while_driving() -> None:
    safety, _ = reached(State.AUTO)
    assert safety.arrived()[:2] == (State.HOLD, Reason.ARRIVED)
    safety, _ = reached(State.MANUAL)
    assert safety.arrived().state is State.MANUAL


@pytest.mark.parametrize("name", list(vars(SafetyLimits())))
@pytest.mark.parametrize("wrong", [0, -1.0, NAN, INF])
def test_limits_are_positive_numbers(name: str, wrong: float) -> None:
    with pytest.raises(ConfigError, match=f"{name}: expected a positive number"):
        SafetyLimits(**{name: wrong})  # type: ignore[arg-type]


def test_the_speed_limit_is_at_most_the_tables() -> None:
    with pytest.raises(ConfigError, match="max_wheel_mps: expected at most"):
        SafetyLimits(max_wheel_mps=MAX_WHEEL_MPS + 0.01)


class AnyDrive(RuleBasedStateMachine):
    """Whatever happens, the wheels may turn only on a person's word since the last trouble."""

    def __init__(self) -> None:
        super().__init__()
        self.clock = FakeClock()
        self.safety = Safety(self.clock)
        self.limits = self.safety.limits
        self.armed = False  # a person armed, and no trouble came since
        self.told_to_move = False  # and told it to drive, and nothing stopped it since
        self.inputs: Optional[Inputs] = None
        self.looked_s = self.clock.now_s

    def trouble(self) -> None:
        self.armed = self.told_to_move = False

    def shut(self, state: State) -> bool:
        loop_age_s = self.clock.now_s - self.looked_s
        reasons = {trip.reason for trip in trips(self.inputs or GOOD, loop_age_s, self.limits)}
        return bool(reasons & WATCHED.get(state, frozenset()))

    @rule(inputs=st.just(GOOD) | st.sampled_from([inputs for _, inputs in CASES]))
    def look(self, inputs: Inputs) -> None:
        self.inputs = inputs
        if self.shut(self.safety.verdict.state):
            self.trouble()
        self.safety.check(inputs)
        self.looked_s = self.clock.now_s

    @rule(wait_s=st.sampled_from((0.0, 0.05, 0.1, 0.19, 0.3, 10.0, -0.2)))
    def time_passes(self, wait_s: float) -> None:
        self.clock.now_s += wait_s

    @rule()
    def second_thread_watches(self) -> None:
        if not 0.0 <= self.clock.now_s - self.looked_s <= self.limits.loop_age_s:
            self.trouble()
        self.safety.watch()

    @rule(reason=st.sampled_from((Reason.CAMERA, Reason.MOTORS, Reason.SUBSCRIBER)))
    def a_part_fails(self, reason: Reason) -> None:
        self.safety.fault(reason, "failed")
        self.trouble()

    @rule()
    def arrives(self) -> None:
        if self.safety.verdict.state is State.AUTO:
            self.trouble()
        self.safety.arrived()

    @rule(command=st.sampled_from(list(Command)))
    def a_person_asks(self, command: Command) -> None:
        before = self.safety.verdict.state
        answer = self.safety.command(command)
        after = self.safety.verdict.state
        if after in WATCHED and after is not before:
            assert self.inputs is not None
            assert 0.0 <= self.clock.now_s - self.looked_s <= self.limits.loop_age_s
        if command in ALWAYS_TAKEN:
            assert answer.accepted
            self.trouble()
        elif answer.accepted and command is Command.ARM:
            self.armed = True
        elif answer.accepted:
            self.told_to_move = after in MOVING

    @precondition(lambda self: not self.armed)
    @rule()
    def a_calm_minute_changes_nothing(self) -> None:
        before = self.safety.verdict
        for _ in range(600):
            self.clock.now_s += 0.1
            assert self.safety.check(GOOD).state not in MOVING
        self.inputs, self.looked_s = GOOD, self.clock.now_s
        assert self.safety.verdict == before

    @invariant()
    def motion_is_a_persons_wish(self) -> None:
        state = self.safety.verdict.state
        assert (self.safety.verdict.state in MOVING) == (state.value in ("AUTO", "MANUAL"))
        if state in WATCHED:
            assert self.armed
        assert self.safety.verdict.state not in MOVING or self.told_to_move


TestAnyDrive = AnyDrive.TestCase
TestAnyDrive.settings = settings(stateful_step_count=40)  # as many drives as the profile says


AGES = {  # what grows old, its limit [s], and what a person reads
    "loop_age_s": (0.2, "the control loop"),
    "frame_age_s": (0.2, "the camera's newest frame"),
    "blind_s": (0.5, "the last picture that shows anything"),
    "pose_age_s": (1.0, "the newest overhead pose"),
    "link_age_s": (1.0, "the operator's last sign of life"),
    "manual_age_s": (0.3, "the last manual command"),
}


@pytest.mark.parametrize("name", AGES)
def test_what_is_too_old_or_of_the_future_says_so_with_its_age(name: str) -> None:
    limit_s, what = AGES[name]

    def told(age_s: float) -> List[str]:
        loop_age_s = age_s if name == "loop_age_s" else 0.1
        ages = {"frame_age_s": 0.1, "manual_age_s": 0.1}
        ages.update({} if name == "loop_age_s" else {name: age_s})
        return [trip.sentence for trip in trips(Inputs(**ages), loop_age_s, SafetyLimits())]

    assert told(0.0) == told(limit_s) == []
    for age_s in (limit_s + 0.05, 7.0):
        old = f"{what} is {1e3 * age_s:.0f} ms old, more than {1e3 * limit_s:.0f} ms"
        assert [sentence.split(";")[0] for sentence in told(age_s)] == [old]
    (future,) = told(-0.25)
    assert future.startswith(f"{what} is dated in the future (-0.25 s): the clock jumped")
    (never,) = told(math.inf)
    assert never.startswith(f"{what} has not come yet")


def test_between_two_turns_nothing_is_asked_that_comes_with_the_wish_to_drive() -> None:
    """The first manual command and the mission come with the next turn of the loop."""
    for wish, inputs in (
        (Command.MANUAL, replace(GOOD, manual_age_s=None)),
        (Command.AUTO, replace(GOOD, no_mission=True)),
    ):
        safety, clock = reached(State.READY)
        safety.check(inputs)
        assert safety.command(wish).accepted
        clock.sleep(0.02)
        assert safety.watch().state in MOVING


def test_a_robot_that_may_never_drive_is_never_armed() -> None:
    clock = FakeClock()
    safety = Safety(clock, never="this is a dry run")
    safety.check(GOOD)
    assert safety.command(Command.ARM) == (False, "arm is refused: this is a dry run")
    assert safety.verdict.state is State.DISARMED
    assert safety.command(Command.STOP).accepted
