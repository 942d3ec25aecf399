"""A taught policy: without a proof that is good enough the robot does not arm."""

from __future__ import annotations

from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from robot.cli.doctor import FAIL, OK, check_policy
from robot.config import RobotConfig
from robot.contract import PolicyContract, Proof
from robot.geometry import Pose
from robot.runtime.assemble import open_robot
from robot.safety.gates import Inputs
from robot.safety.state_machine import Command, Safety, State
from tests.robot.clocks import FakeClock
from tests.robot.fakes import after
from tests.robot.runtime.test_assemble import DarkCamera, RollingMotors
from tests.robot.tiny_onnx import lane_contract, write_policy

GOOD = Proof(100, 94, 0.876, 0.97, 100, 90, "94 % of 100 drives; fails most on a bend", "on a bend")


def taught(**changes: Any) -> PolicyContract:
    return lane_contract(taught_from="lane_coached", proof=replace(GOOD, **changes))


def test_only_a_taught_policy_needs_a_proof() -> None:
    assert lane_contract().unproven == ""
    assert taught().unproven == ""
    assert "no proof" in lane_contract(taught_from="lane_coached").unproven


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"low": 0.79}, "79%"),
        ({"low": float("nan")}, "nan"),
        ({"foretold": 74}, "74%"),
        ({"drives": 0, "steered": 39, "foretold": 39}, "39 moments of steering, expected 40"),
        ({"drives": 0, "steered": 0, "foretold": 0}, "0 moments"),
        ({"drives": 0, "foretold": 74}, "74%"),
        ({"low": 0.95}, "contradict"),  # more sure than 94 of 100 can be
        ({"low": 5.0}, "contradict"),
        ({"succeeded": 101}, "contradict"),
        ({"succeeded": 0}, "contradict"),
        ({"drives": -1, "succeeded": -1}, "contradict"),
        ({"foretold": 101}, "contradict"),
        ({"steered": -5, "foretold": 0}, "contradict"),
    ],
)
def test_a_proof_below_the_bar_is_none(changes: Any, said: str) -> None:
    assert said in taught(**changes).unproven


def test_a_proof_at_the_bar_is_enough() -> None:
    assert taught(low=0.8, foretold=75).unproven == ""
    assert taught(steered=0, foretold=0).unproven == ""  # nobody was asked
    assert taught(drives=0, low=0.0, steered=40, foretold=30).unproven == ""  # without a map


def test_a_proof_travels_in_the_metadata() -> None:
    assert PolicyContract.from_json(taught().to_json()) == taught()


def test_a_robot_that_must_not_arm_obeys_no_command_but_stops() -> None:
    clock = FakeClock()
    safety = Safety(clock.now, never="the policy is taught from lane_coached, no proof")
    safety.check(Inputs(frame_age_s=0.03, frame_repeats=1, link_age_s=0.1))
    answer = safety.command(Command.ARM)
    assert not answer.accepted
    assert answer.sentence == "arm is refused: the policy is taught from lane_coached, no proof"
    for command in Command:
        safety.command(command)
        assert safety.verdict.state is State.DISARMED
    assert safety.command(Command.DISARM).accepted


def test_the_robot_does_not_arm_with_an_unproven_policy(tmp_path: Path) -> None:
    parts = {
        "camera": nullcontext(DarkCamera()),
        "motors": nullcontext(RollingMotors(Pose(0.0, 0.0, 0.0))),
    }
    model = write_policy(tmp_path / "lane.onnx", taught(low=0.5))
    with open_robot(RobotConfig(str(model)), **parts) as runtime:
        runtime.run(after(3))
        answer = runtime.safety.command(Command.ARM)
    assert not answer.accepted
    assert "taught from lane_coached, proven to 50% of drives, expected 80%" in answer.sentence


def test_the_doctor_says_so(tmp_path: Path) -> None:
    proven = write_policy(tmp_path / "proven.onnx", taught())
    fine = check_policy(RobotConfig(str(proven)))
    assert fine.level == OK
    assert GOOD.sentence in fine.says
    bad = write_policy(tmp_path / "bad.onnx", taught(low=0.5))
    found = check_policy(RobotConfig(str(bad)))
    assert found.level == FAIL
    assert "proven to 50% of drives, expected 80%" in found.says
