"""What a report says of a turn is what the turn was."""

from __future__ import annotations

from typing import List

import pytest

from robot.geometry import WheelSpeeds
from robot.link.messages import Telemetry
from robot.runtime.reports import Reporter
from robot.safety.gates import SafetyLimits
from robot.safety.state_machine import Command
from tests.robot.runtime.test_loop import Bench, guidance, raises

LIMITS = SafetyLimits(frame_age_s=0.21, loop_age_s=0.22, pose_age_s=1.1, link_age_s=1.2)


def driven(bench: Bench, turns: int = 1, gap_s: float = 0.1) -> List[Telemetry]:
    """The reports of some turns."""
    reports: List[Telemetry] = []
    reporter = Reporter(reports.append, None, Telemetry("daisy", "DISARMED"), LIMITS)
    for _ in range(turns):
        reporter.on_tick(bench.runtime.step(lag_s=0.07))
        bench.clock.now_s += gap_s
    return reports


def test_each_age_is_told_with_its_own_limit() -> None:
    bench = Bench(limits=LIMITS).drive()
    guidance(pose_age_s=0.5)(bench)
    bench.operator.silent_s = 0.6
    (report,) = driven(bench)
    told = {each.name: (each.age_s, each.limit_s) for each in report.inputs}
    assert told["camera"] == (pytest.approx(0.03), 0.21)
    assert told["pose"] == (0.5, 1.1)
    assert told["operator"] == (0.6, 1.2)
    assert report.lag_s == pytest.approx(0.03), "from the capture, not from the deadline"


def test_a_person_who_drives_otherwise_than_any_action_is_told_as_none() -> None:
    bench = Bench().drive()
    assert driven(bench)[0].action == 2
    bench.runtime.ask(Command.MANUAL, WheelSpeeds(0.1, -0.05))
    report = driven(bench, 2)[-1]
    assert report.wheels == pytest.approx((0.1, -0.05))
    assert report.action is None
    bench.runtime.ask(Command.MANUAL, WheelSpeeds(0.3024, 0.1))
    assert driven(bench)[0].action is None, "one wheel alone is as of an action"
    bench.runtime.ask(Command.MANUAL, WheelSpeeds(0.3024, 0.0576))
    assert driven(bench)[0].action == 4
    bench.runtime.ask(Command.STOP)
    assert driven(bench)[0].action is None


def test_one_late_turn_does_not_halve_the_rate() -> None:
    bench = Bench()
    reports: List[Telemetry] = []
    reporter = Reporter(reports.append, None, Telemetry("daisy", "DISARMED"), LIMITS)
    for gap_s in (0.09, 0.09, 0.09, 0.19, 0.09):  # and 0.01 s for the policy
        reporter.on_tick(bench.runtime.step())
        bench.clock.now_s += gap_s
    assert reports[3].fps == pytest.approx(10.0)
    assert 9.0 < reports[4].fps < 10.0


def test_without_values_of_the_policy_none_are_told() -> None:
    bench = Bench().drive()
    assert driven(bench)[0].values == (0.0, 0.0, 1.0, 0.0, 0.0)
    bench.policy.broken = raises(ValueError())
    assert driven(bench)[0].values == ()
