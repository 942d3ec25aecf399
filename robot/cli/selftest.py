"""Test the motors step by step, with the wheels off the floor; a person watches and answers.

Ctrl-C ends it at any moment: the wheels brake and the coils go off. Exit status 1 when a step
failed.
"""

import argparse
import math
from pathlib import Path
from typing import ContextManager, Iterator, List, NamedTuple

from robot.bringup.roller import Prompts, Roller
from robot.computer.clock import Clock, MonotonicClock
from robot.computer.systemd import on_ending
from robot.config import RobotConfig
from robot.errors import ConfigError
from robot.geometry import WheelSpeeds
from robot.hat.config import HatConfig
from robot.hat.stepping import BRAKE_S
from robot.hat.thread import MotorThread, real_motors
from robot.typed_config import load_yaml

GENTLE_MPS = 0.08
STOP_TEST_S = 1.5
SLACK_STEPS = 3.0  # beyond what braking takes, before the stop counts as late
_FORWARD, _BACK = "turn once, FORWARD, evenly?", "turn once, BACKWARD, evenly?"
MOTIONS = (  # turns of the left and of the right wheel
    ("left forward", 1.0, 0.0, f"Did the LEFT wheel alone {_FORWARD}"),
    ("left backward", -1.0, 0.0, f"Did the LEFT wheel alone {_BACK}"),
    ("right forward", 0.0, 1.0, f"Did the RIGHT wheel alone {_FORWARD}"),
    ("right backward", 0.0, -1.0, f"Did the RIGHT wheel alone {_BACK}"),
    ("both forward", 2.0, 2.0, "Did BOTH wheels turn twice, forward, at one speed?"),
    ("both apart", -1.0, 1.0, "Did the left wheel turn BACKWARD and the right FORWARD?"),
)
MOTION_REMEDY = (
    "the other wheel moved: exchange hat.left.port and hat.right.port; the wrong way: flip that "
    "motor's `reversed`; it trembled: a terminal holds wires of both windings; more or less than a "
    "turn: mend hat.steps_per_rev (docs/wiring.md)"
)
STOP_REMEDY = "lower hat.acceleration_mps2 and hat.start_stop_mps; look for a loose wheel"
HOLD_REMEDY = "raise hat.hold_duty; check the motor supply"
FREE_REMEDY = "switch the motor supply off at once; the HAT does not obey (docs/wiring.md)"
LAST = "coils off"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The command's options."""
    parser.add_argument("--config", type=Path, required=True, help="the robot's YAML file")


def run(options: argparse.Namespace) -> int:
    """Do it; 1 when a step failed."""
    on_ending()
    hat = load_yaml(RobotConfig, options.config).hat
    return try_motors(hat, real_motors(hat), Prompts(), MonotonicClock())


class Outcome(NamedTuple):
    """One step of the test; ``remedy`` says what to look at when it failed."""

    name: str
    passed: bool
    remedy: str


def try_motors(
    hat: HatConfig, motors: ContextManager[MotorThread], person: Prompts, clock: Clock
) -> int:
    """Every step with any motors, in order; 0 when all passed, 1 when one failed.

    After a failed one the person decides whether to go on. ConfigError: the wheels are on the
    floor, or the input ended. HardwareError: the motors failed.
    """
    outcomes: List[Outcome] = []
    with motors as opened:
        if not person.agrees("Do both wheels hang free, with nothing near them?"):
            raise ConfigError("expected wheels off the floor; put the robot on a box first")
        for outcome in _steps(Roller(opened, hat, clock), person):
            outcomes.append(outcome)
            if not outcome.passed:
                person.tell(f"FAIL  {outcome.name}: {outcome.remedy}")
                if outcome.name != LAST and not person.agrees("Go on with the next step?"):
                    break
        opened.release()
    for outcome in outcomes:
        person.tell(f"{'OK  ' if outcome.passed else 'FAIL'}  {outcome.name}")
    return int(not all(outcome.passed for outcome in outcomes))


def _steps(roller: Roller, person: Prompts) -> Iterator[Outcome]:
    for name, left, right, question in MOTIONS:
        person.tell(f"--- {name}")
        yield Outcome(name, _moves(roller, person, left, right, question), MOTION_REMEDY)
    person.tell("--- stop: both wheels run fast, then stop at once")
    yield Outcome("stop", _stops(roller, person), STOP_REMEDY)
    person.tell("--- hold: the coils hold the wheels now")
    held = person.agrees("Do both wheels RESIST when you turn them gently by hand?")
    yield Outcome("hold", held, HOLD_REMEDY)
    roller.motors.release()
    roller.clock.sleep(0.5)
    person.tell(f"--- {LAST}")
    yield Outcome(LAST, person.agrees("Do both wheels turn FREELY by hand now?"), FREE_REMEDY)


def _moves(roller: Roller, person: Prompts, left: float, right: float, question: str) -> bool:
    turn_m = 2.0 * math.pi * roller.config.drive.wheel_radius_m
    while True:
        roller.roll(left * turn_m, right * turn_m, GENTLE_MPS)
        if person.agrees(question):
            return True
        if not person.agrees("Show it again?"):
            return False


def _stops(roller: Roller, person: Prompts) -> bool:
    """From the fastest speed to rest, as after a fault; the steps say how far."""
    config, motors = roller.config, roller.motors
    fast = WheelSpeeds(config.max_speed_mps, config.max_speed_mps)
    end_s = roller.clock.now() + STOP_TEST_S
    while roller.clock.now() < end_s:
        motors.set_wheels(fast)
        roller.clock.sleep(0.1)
    before = motors.counts
    motors.stop()
    roller.clock.sleep(2.0 * BRAKE_S)
    rolled = max(abs(b - a) for a, b in zip(before, motors.counts)) * config.step_m
    most_m = 0.5 * config.max_speed_mps * BRAKE_S + SLACK_STEPS * config.step_m
    person.tell(f"    it took {1e3 * rolled:.0f} mm; at most {1e3 * most_m:.0f} mm are right")
    return person.agrees("Did both wheels stop at once, without a knock?") and rolled <= most_m
