"""The whole state machine against tables written here: every state, command and reason.

Nothing of the tables of `robot.safety` is imported but the names.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Dict, List, Tuple

import pytest

from robot.safety.gates import Inputs, Reason, SafetyLimits
from robot.safety.state_machine import MOVING, Command, Safety, State
from tests.robot.clocks import FakeClock

# Columns: arm, auto, manual, stop, disarm, clear. "-": refused, the state stays; "=": accepted, it
# stays.
COMMANDS = ("arm", "auto", "manual", "stop", "disarm", "clear")
LEADS = {
    "DISARMED": ("READY", "-", "-", "=", "=", "-"),
    "READY": ("-", "AUTO", "MANUAL", "HOLD", "DISARMED", "-"),
    "AUTO": ("-", "=", "MANUAL", "HOLD", "DISARMED", "-"),
    "MANUAL": ("-", "AUTO", "=", "HOLD", "DISARMED", "-"),
    "HOLD": ("READY", "-", "-", "=", "DISARMED", "-"),
    "FAULT": ("-", "-", "-", "=", "=", "DISARMED"),
}
WAY_TO: Dict[str, Tuple[str, ...]] = {
    "DISARMED": (),
    "READY": ("arm",),
    "AUTO": ("arm", "auto"),
    "MANUAL": ("arm", "manual"),
    "HOLD": ("arm", "stop"),
    "FAULT": (),
}
# What each gate does to READY, AUTO and MANUAL. DISARMED, HOLD and FAULT stay what they are.
GATES = {
    "loop_late": ("FAULT", "FAULT", "FAULT"),
    "frame_stale": ("FAULT", "FAULT", "FAULT"),
    "frame_frozen": ("FAULT", "FAULT", "FAULT"),
    "picture_blind": ("READY", "FAULT", "MANUAL"),
    "picture_wrong": ("READY", "FAULT", "MANUAL"),
    "picture_still": ("READY", "FAULT", "MANUAL"),
    "non_finite": ("READY", "FAULT", "MANUAL"),
    "duplicate_publisher": ("READY", "FAULT", "MANUAL"),
    "pose_jump": ("READY", "FAULT", "MANUAL"),
    "pose_doubt": ("READY", "FAULT", "MANUAL"),
    "not_moving": ("READY", "FAULT", "MANUAL"),
    "pose_stale": ("READY", "HOLD", "MANUAL"),
    "pose_unsure": ("READY", "HOLD", "MANUAL"),
    "off_map": ("READY", "HOLD", "MANUAL"),
    "off_path": ("READY", "HOLD", "MANUAL"),
    "no_mission": ("READY", "HOLD", "MANUAL"),
    "link_lost": ("HOLD", "HOLD", "HOLD"),
    "manual_stale": ("READY", "AUTO", "HOLD"),
}
GOOD = Inputs(frame_age_s=0.03, pose_age_s=0.3, link_age_s=0.2, manual_age_s=0.1)
# The least that shuts each gate, and the most that does not. Of the loop it is the time waited.
SHUTS: Dict[str, Dict[str, object]] = {
    "frame_stale": {"frame_age_s": 0.201},
    "frame_frozen": {"frame_repeats": 5},
    "picture_blind": {"blind_s": 0.51},
    "picture_wrong": {"picture_wrong": "upside down"},
    "picture_still": {"still_s": 1.31},
    "non_finite": {"values_finite": False},
    "duplicate_publisher": {"duplicate_publisher": True},
    "pose_jump": {"pose_jump": True},
    "pose_doubt": {"pose_doubt": True},
    "not_moving": {"not_moving": True},
    "pose_stale": {"pose_age_s": 1.01},
    "pose_unsure": {"pose_within": (0.0801, 0.1)},
    "off_map": {"off_map": True},
    "off_path": {"off_path": True},
    "no_mission": {"no_mission": True},
    "link_lost": {"link_age_s": 1.01},
    "manual_stale": {"manual_age_s": 0.31},
}
PASSES: Dict[str, Dict[str, object]] = {
    "frame_stale": {"frame_age_s": 0.199},
    "frame_frozen": {"frame_repeats": 4},
    "picture_blind": {"blind_s": 0.49},
    "picture_still": {"still_s": 1.29},
    "pose_stale": {"pose_age_s": 0.99},
    "pose_unsure": {"pose_within": (0.0799, 0.349)},
    "link_lost": {"link_age_s": 0.99},
    "manual_stale": {"manual_age_s": 0.29},
}
# What a person is told of each gate, with the figures of `SHUTS`.
TOLD = {
    "loop_late": "the control loop is 210 ms old, more than 200 ms",
    "frame_stale": "the camera's newest frame is 201 ms old, more than 200 ms",
    "frame_frozen": "the same picture 6 times",
    "picture_blind": "the last picture that shows anything is 510 ms old, more than 500 ms",
    "picture_wrong": "upside down",
    "picture_still": "for 1.3 s the picture has not moved",
    "non_finite": "no finite values",
    "duplicate_publisher": "two localizers",
    "pose_jump": "jumped",
    "pose_doubt": "tell another way than the wheels",
    "not_moving": "the wheels step, but the overhead poses stand",
    "pose_stale": "the newest overhead pose is 1010 ms old, more than 1000 ms",
    "pose_unsure": "known to 8 cm and 6 degrees, not to 8 cm and 20 degrees",
    "off_map": "off the map",
    "off_path": "left its planned path",
    "no_mission": "no destination",
    "link_lost": "the operator's last sign of life is 1010 ms old, more than 1000 ms",
    "manual_stale": "the last manual command is 310 ms old, more than 300 ms",
}
# Where arming, AUTO and MANUAL are refused while a gate is shut.
ROBOT = ("loop_late", "frame_stale", "frame_frozen", "link_lost")
REFUSES: Dict[str, Tuple[str, ...]] = {
    "arm": ROBOT,
    "auto": (
        *ROBOT,
        *("picture_blind", "picture_wrong", "picture_still", "non_finite", "duplicate_publisher"),
        *("pose_jump", "pose_doubt", "not_moving", "pose_stale", "pose_unsure"),
        *("off_map", "off_path"),
    ),
    "manual": ROBOT,
}
PARTS = ("camera", "policy", "motors", "navigator", "operator", "subscriber", "runtime")
ORDER = ("READY", "AUTO", "MANUAL")


def reached(state: str) -> Tuple[Safety, FakeClock]:
    clock = FakeClock()
    safety = Safety(clock)
    safety.check(GOOD)
    for command in WAY_TO[state]:
        assert safety.command(Command(command)).accepted
    if state == "FAULT":
        safety.fault(Reason.CAMERA, "unplugged")
    assert safety.verdict.state.value == state
    return safety, clock


def test_the_tables_name_every_state_command_and_reason() -> None:
    assert set(LEADS) == {state.value for state in State}
    assert set(COMMANDS) == {command.value for command in Command}
    told = {"boot", "person", "arrived", *GATES, *PARTS}
    others = {reason.value for reason in Reason} - told
    assert others == set(), "write into GATES or PARTS what they lead to"


@pytest.mark.parametrize("state", LEADS)
@pytest.mark.parametrize("command", COMMANDS)
def test_every_command_in_every_state(state: str, command: str) -> None:
    safety, _ = reached(state)
    leads = LEADS[state][COMMANDS.index(command)]
    answer = safety.command(Command(command))
    assert answer.accepted is (leads != "-")
    assert safety.verdict.state.value == (state if leads in "-=" else leads)
    if leads == "-":
        possible = ", ".join(sorted(c for c, way in zip(COMMANDS, LEADS[state]) if way not in "-="))
        assert answer.sentence == f"{command} is not possible in {state}; possible: {possible}"
    if leads not in "-=":
        assert (safety.verdict.reason.value, answer.sentence) == ("person", "")
        assert safety.verdict.sentence == f"{command}, by a person"
    assert (safety.verdict.state in MOVING) is (safety.verdict.state.value in ("AUTO", "MANUAL"))


def shut(gate: str, state: str) -> Safety:
    """A supervisor in a state, whose gate shuts."""
    safety, clock = reached(state)
    clock.now_s += 0.21 if gate == "loop_late" else 0.1
    safety.check(replace(GOOD, **SHUTS.get(gate, {})))  # type: ignore[arg-type]
    return safety


@pytest.mark.parametrize("gate", GATES)
@pytest.mark.parametrize("state", LEADS)
def test_every_gate_in_every_state(state: str, gate: str) -> None:
    safety = shut(gate, state)
    leads = GATES[gate][ORDER.index(state)] if state in ORDER else state
    assert safety.verdict.state.value == leads
    if leads != state:
        assert safety.verdict.reason.value == gate
        assert len(safety.verdict.sentence) > 10
        safety.check(GOOD)
        assert safety.verdict.state.value == leads, "nothing resumes by itself"


@pytest.mark.parametrize("gate", GATES)
def test_every_gate_says_what_is_wrong(gate: str) -> None:
    assert TOLD[gate] in shut(gate, "MANUAL" if gate == "manual_stale" else "AUTO").verdict.sentence


@pytest.mark.parametrize("gate", GATES)
@pytest.mark.parametrize("state", ["HOLD", "FAULT", "DISARMED"])
@pytest.mark.parametrize("command", ["auto", "manual"])
def test_after_every_trouble_only_arming_leads_on(state: str, gate: str, command: str) -> None:
    safety = shut(gate, state)
    safety.check(GOOD)
    assert not safety.command(Command(command)).accepted
    assert safety.verdict.state not in MOVING


@pytest.mark.parametrize("gate", GATES)
@pytest.mark.parametrize("command", ["arm", "auto", "manual"])
def test_what_refuses_a_wish_to_move(command: str, gate: str) -> None:
    source = "DISARMED" if command == "arm" else "READY"
    safety, clock = reached(source)
    safety.check(replace(GOOD, **SHUTS.get(gate, {})))  # type: ignore[arg-type]
    if gate == "loop_late":
        clock.now_s += 0.21
    answer = safety.command(Command(command))
    assert answer.accepted is (gate not in REFUSES[command])


@pytest.mark.parametrize("command", ["arm", "auto", "manual"])
def test_after_a_clock_that_jumped_back_nobody_can_arm_or_drive(command: str) -> None:
    safety, clock = reached("DISARMED" if command == "arm" else "READY")
    clock.now_s -= 0.01
    answer = safety.command(Command(command))
    assert not answer.accepted
    assert "the clock jumped" in answer.sentence


@pytest.mark.parametrize("state", ["DISARMED", "HOLD", "FAULT"])
def test_arming_asks_what_was_seen_last_whatever_the_state_was(state: str) -> None:
    safety, _ = reached(state)
    safety.check(replace(GOOD, frame_age_s=0.3))
    if state == "FAULT":
        assert safety.command(Command.CLEAR).accepted
    assert "frame is 300 ms old" in safety.command(Command.ARM).sentence
    assert safety.verdict.state.value in ("DISARMED", "HOLD")


def test_a_state_is_dated_from_the_moment_that_it_began() -> None:
    safety, clock = reached("READY")
    clock.now_s += 0.05
    safety.command(Command.AUTO)
    assert safety.verdict.since_s == clock.now_s
    clock.now_s += 0.05
    safety.check(GOOD)
    assert safety.verdict.since_s == pytest.approx(clock.now_s - 0.05)


@pytest.mark.parametrize("gate", PASSES)
def test_what_just_passes(gate: str) -> None:
    for state in ORDER:
        safety, clock = reached(state)
        clock.now_s += 0.199
        safety.check(replace(GOOD, **PASSES[gate]))  # type: ignore[arg-type]
        assert safety.verdict.state.value == state


@pytest.mark.parametrize("age_s", [-0.01, math.nan, math.inf])
@pytest.mark.parametrize(
    ("name", "state", "leads"),
    [
        ("frame_age_s", "AUTO", "FAULT"),
        ("blind_s", "AUTO", "FAULT"),
        ("still_s", "AUTO", "FAULT"),
        ("pose_age_s", "AUTO", "HOLD"),
        ("link_age_s", "AUTO", "HOLD"),
        ("manual_age_s", "MANUAL", "HOLD"),
    ],
)
def test_an_age_that_cannot_be_is_too_old(name: str, state: str, leads: str, age_s: float) -> None:
    safety, _ = reached(state)
    safety.check(replace(GOOD, **{name: age_s}))
    assert safety.verdict.state.value == leads
    told = "not moved" if name == "still_s" else "not come yet" if age_s == math.inf else "future"
    assert told in safety.verdict.sentence


@pytest.mark.parametrize("part", PARTS)
@pytest.mark.parametrize("state", LEADS)
def test_every_part_that_fails_in_every_state(state: str, part: str) -> None:
    safety, _ = reached(state)
    safety.fault(Reason(part), "it broke")
    assert safety.verdict.state.value == "FAULT"
    assert safety.verdict.reason.value == ("camera" if state == "FAULT" else part)


@pytest.mark.parametrize("state", LEADS)
def test_arriving_in_every_state(state: str) -> None:
    safety, _ = reached(state)
    safety.arrived()
    assert safety.verdict.state.value == ("HOLD" if state == "AUTO" else state)


def test_the_limits_by_default() -> None:
    limits = SafetyLimits()
    told: List[float] = [limits.frame_age_s, limits.loop_age_s, limits.pose_age_s]
    told += [limits.link_age_s, limits.manual_age_s, limits.blind_s, limits.still_s]
    assert told == [0.2, 0.2, 1.0, 1.0, 0.3, 0.5, 1.3]
    assert limits.frozen_frames == 5
    assert round(limits.max_wheel_mps, 4) == 0.3459
