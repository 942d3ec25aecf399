from __future__ import annotations

import math
from typing import Optional, Tuple

import pytest

from robot.bringup.roller import Prompts
from robot.cli.selftest import MOTIONS, try_motors
from robot.errors import ConfigError, HardwareError
from robot.geometry import WheelSpeeds
from robot.hat.config import HatConfig, MotorConfig
from robot.hat.stepping import Steps
from sim_pybullet.virtual.i2c import BusFault
from tests.robot.bringup.bench import BenchMotors, Spectator
from tests.robot.hat.rig import ALL_OFF

STEPS = len(MOTIONS) + 3


def test_a_robot_that_is_wired_right_passes_every_step_and_ends_with_its_coils_off() -> None:
    motors = BenchMotors(HatConfig())
    person = Spectator(motors)
    assert try_motors(HatConfig(), motors, person, motors) == 0
    assert person.told[-STEPS:] == [f"OK    {line[6:]}" for line in person.told[-STEPS:]]
    assert motors.rig.last.data == ALL_OFF
    assert motors.rig.hat.lost_steps == (0, 0)


WRONG = {
    "left reversed": HatConfig(left=MotorConfig("M1M2", reversed=True)),
    "right not reversed": HatConfig(right=MotorConfig("M3M4", reversed=False)),
    "plugs exchanged": HatConfig(
        left=MotorConfig("M3M4", reversed=True), right=MotorConfig("M1M2")
    ),
}


@pytest.mark.parametrize("wrong", WRONG)
def test_a_robot_that_is_wired_wrong_is_found_with_what_to_do(wrong: str) -> None:
    motors = BenchMotors(WRONG[wrong])
    person = Spectator(motors)
    assert try_motors(WRONG[wrong], motors, person, motors) == 1
    failed = "right forward" if "right" in wrong else "left forward"
    assert person.told[-1] == f"FAIL  {failed}"
    assert any("`reversed`" in line and "exchange" in line for line in person.told)
    assert not motors.coils_on


@pytest.mark.parametrize("at", [0, 1, 7, STEPS])
def test_an_interrupt_at_any_question_leaves_the_coils_off(at: int) -> None:
    motors = BenchMotors(HatConfig())
    person = Spectator(motors)

    def interrupt(_question: str) -> None:
        if len(person.asked) > at:
            raise KeyboardInterrupt

    person.interrupt = interrupt
    with pytest.raises(KeyboardInterrupt):
        try_motors(HatConfig(), motors, person, motors)
    assert not motors.coils_on
    assert len(person.asked) == at + 1


def test_an_interrupt_while_the_wheels_run_brakes_them_and_switches_off() -> None:
    motors = BenchMotors(HatConfig())
    person = Spectator(motors)
    with pytest.raises(KeyboardInterrupt):
        try_motors(HatConfig(), motors, person, Interrupting(motors, after_s=2.0))
    assert not motors.coils_on
    angles_rad = motors.angles_rad
    motors.rig.clock.sleep(5.0)
    assert motors.angles_rad == pytest.approx(angles_rad, abs=0.1)


class Interrupting:
    """A clock whose sleep is broken off by Ctrl-C."""

    def __init__(self, motors: BenchMotors, after_s: float) -> None:
        self._motors, self._until_s = motors, motors.now() + after_s

    def now(self) -> float:
        return self._motors.now()

    def sleep(self, duration_s: float) -> None:
        self._motors.sleep(duration_s)
        if self.now() > self._until_s:
            raise KeyboardInterrupt


def test_a_motion_is_shown_again_to_who_missed_it() -> None:
    motors = BenchMotors(HatConfig())
    person = Spectator(motors)
    agrees, missed = person.agrees, ["LEFT wheel alone turn once, FORWARD"]

    def look_away(question: str) -> bool:
        if missed and missed[0] in question:
            missed.pop()
            return agrees(question) and False
        return agrees(question) or question == "Show it again?"

    person.agrees = look_away  # type: ignore[method-assign]
    assert try_motors(HatConfig(), motors, person, motors) == 0
    assert len([each for each in person.asked if "LEFT wheel alone turn once, F" in each]) == 2


def test_after_the_last_step_nobody_is_asked_to_go_on() -> None:
    motors = BenchMotors(HatConfig())
    person = Spectator(motors)
    agrees = person.agrees
    person.agrees = lambda question: "FREELY" not in question and agrees(question)  # type: ignore[method-assign]
    assert try_motors(HatConfig(), motors, person, motors) == 1
    assert person.told[-1] == "FAIL  coils off"
    assert "RESIST" in person.asked[-1]
    assert any("switch the motor supply off at once" in line for line in person.told)


class Late(BenchMotors):
    """Wheels that are counted on by so many steps after a stop."""

    def __init__(self, steps: Tuple[int, int]) -> None:
        super().__init__(HatConfig())
        self._steps = steps
        self._stopped: Optional[Steps] = None
        self._still_s = math.inf

    def stop(self) -> None:
        self._stopped, self._still_s = super().counts, self.now() + 0.15
        super().stop()

    @property
    def counts(self) -> Steps:
        if self._stopped is None or self.now() < self._still_s:
            return self._stopped or super().counts
        return self._stopped[0] + self._steps[0], self._stopped[1] + self._steps[1]


@pytest.mark.parametrize(
    ("steps", "status"), [((17, 17), 0), ((18, 0), 1), ((0, 18), 1), ((0, -18), 1)]
)
def test_a_stop_that_takes_more_than_36_mm_fails_whatever_the_person_saw(
    steps: Tuple[int, int], status: int
) -> None:
    motors = Late(steps)
    person = Spectator(motors)
    assert try_motors(HatConfig(), motors, person, motors) == status
    assert status == 0 or person.told[-1] == "FAIL  stop"
    assert any("at most 36 mm are right" in line for line in person.told)


def test_the_wheels_turn_gently_but_to_be_stopped_from_their_fastest() -> None:
    motors, fastest, told_s = BenchMotors(HatConfig()), {"": 0.0}, [0.0]
    person, set_wheels = Spectator(motors), motors.set_wheels

    def note(wheels: WheelSpeeds) -> None:
        step = [line for line in person.told if line.startswith("--- ")][-1].split(":")[0]
        fastest[step] = max(map(abs, (*wheels, fastest.get(step, 0.0))))
        told_s.append(motors.now())
        set_wheels(wheels)

    motors.set_wheels = note  # type: ignore[method-assign]
    assert try_motors(HatConfig(), motors, person, motors) == 0
    assert fastest.pop("--- stop") == HatConfig().max_speed_mps
    assert max(fastest.values()) == pytest.approx(0.08)
    assert told_s[-1] - told_s[-14] == pytest.approx(1.3, abs=0.05), "long enough to reach it"


def test_wheels_on_the_floor_and_motors_that_fail_end_it() -> None:
    motors = BenchMotors(HatConfig())
    person = Spectator(motors)
    person.agrees = lambda question: False  # type: ignore[method-assign]
    with pytest.raises(ConfigError, match="put the robot on a box"):
        try_motors(HatConfig(), motors, person, motors)
    assert not motors.coils_on
    broken = BenchMotors(HatConfig())
    broken.rig.bus.inject(BusFault.NACK, after=200)
    with pytest.raises(HardwareError, match="0x6F"):
        try_motors(HatConfig(), broken, Spectator(broken), broken)
    assert not broken.coils_on
    dead = BenchMotors(HatConfig())
    dead.dead = True
    with pytest.raises(HardwareError, match="do the motors get their commands"):
        try_motors(HatConfig(), dead, Spectator(dead), dead)


def test_a_person_at_the_terminal_is_asked_until_the_answer_is_one(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    answers = iter(["", "maybe", " Yes ", "ten", "nan", "9,75"])
    monkeypatch.setattr("builtins.input", lambda prompt: next(answers))
    person = Prompts()
    assert person.agrees("Well?")
    assert person.number("How many?") == 9.75
    assert capsys.readouterr().out.count("\n") == 4

    def nobody(_prompt: str) -> str:
        raise EOFError

    monkeypatch.setattr("builtins.input", nobody)
    with pytest.raises(ConfigError, match="a person who answers"):
        person.agrees("Anybody?")
