"""The rules of the road hold what the policy drives; this is told and recorded."""

from __future__ import annotations

import math
from typing import Tuple

import pytest

from robot.contract import ACTION_WHEELS, Action
from robot.errors import ContractError
from robot.geometry import STILL, WheelSpeeds
from robot.link.messages import Telemetry
from robot.recording.topics import Turn
from robot.runtime.reports import Reporter
from robot.safety.gates import SafetyLimits
from robot.safety.governors import Cap, Road, Rules
from robot.safety.road_ahead import RoadAhead
from robot.safety.state_machine import Command, State
from robot.typed_config import from_plain
from tests.robot.runtime.test_loop import Bench

STRAIGHT = ACTION_WHEELS[Action.STRAIGHT]


def at_line(gap_m: float) -> Bench:
    bench = Bench(rules=Rules(stop_lines=True).chain()).drive()
    bench.navigator.guidance = bench.navigator.guidance._replace(ahead=RoadAhead(line_m=gap_m))
    return bench


def test_it_stands_at_the_line_and_then_goes_on() -> None:
    bench = at_line(0.05)
    bench.turn(3)
    stood = bench.heard.ticks[-1]
    assert stood.wheels == STILL
    assert stood.drive is not None
    assert stood.drive.wanted != STILL, "the policy wants to go on"
    assert bench.safety.verdict.state is State.AUTO
    bench.turn(15)
    assert bench.heard.ticks[-1].wheels != STILL


def test_what_held_it_is_told_and_recorded() -> None:
    bench = at_line(0.05)
    bench.turn(3)
    tick = bench.heard.ticks[-1]
    turn = from_plain(Turn, Turn.of(tick).plain())
    assert (turn.most_mps, turn.governed) == (0.0, "it stands at a stop line")
    assert turn.drive == tick.drive
    assert turn.drive is not None
    assert turn.drive.limited(0.4) == tick.wheels
    told = Reporter(None, None, Telemetry("robot", "DISARMED"), SafetyLimits())
    told.on_tick(tick)
    assert told.newest is not None
    assert told.newest.reason == "it stands at a stop line"


def test_without_rules_a_line_is_nothing_and_nothing_is_recorded_of_it() -> None:
    bench = Bench().drive()
    before = bench.heard.ticks[-1].wheels
    bench.navigator.guidance = bench.navigator.guidance._replace(ahead=RoadAhead(line_m=0.05))
    bench.turn(3)
    assert bench.heard.ticks[-1].wheels == before != STILL
    assert not {"most_mps", "governed"} & set(Turn.of(bench.heard.ticks[-1]).plain())


def test_a_person_who_drives_by_hand_is_not_held() -> None:
    bench = at_line(0.05)
    bench.runtime.ask(Command.DISARM)
    bench.runtime.ask(Command.ARM)
    assert bench.runtime.ask(Command.MANUAL, WheelSpeeds(*STRAIGHT)).accepted
    bench.turn(3)
    assert bench.heard.ticks[-1].wheels == pytest.approx(STRAIGHT)


class Broken:
    """A rule that fails."""

    def after(self, road: Road) -> "Tuple[Broken, Cap]":
        raise ContractError(f"no rule for {road.ahead.line_m}")


def test_a_rule_that_fails_stops_the_robot() -> None:
    bench = Bench(rules=(Broken(),))
    bench.turn()
    for command in (Command.ARM, Command.AUTO):
        bench.runtime.ask(command)
    bench.turn()
    assert bench.heard.ticks[-1].inputs.frame_age_s == math.inf, "it looked at no gate"
    bench.turn()
    assert bench.safety.verdict.state is State.FAULT
    assert not bench.motors.turning
