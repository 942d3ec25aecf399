"""Test the motors step by step, with the wheels off the floor; a person watches and answers.

Ctrl-C ends it at any moment: the wheels brake and the coils go off. Exit status 1 when a step
failed.
"""

from __future__ import annotations

import argparse
import math
from pathlib import Path
from typing import Callable, ContextManager, List, NamedTuple, Tuple

from robot.bringup.prompts import Prompts
from robot.bringup.roller import CountedMotors, Roller
from robot.computer.clock import Clock, MonotonicClock
from robot.computer.systemd import interrupt, on_ending
from robot.config import RobotConfig
from robot.errors import ConfigError
from robot.geometry import WheelSpeeds
from robot.hat.config import HatConfig
from robot.hat.stepping import BRAKE_S
from robot.hat.thread import real_motors
from robot.typed_config import load_yaml

GENTLE_MPS = 0.08
STOP_TEST_S = 1.5
SLACK_STEPS = 3.0  # beyond what braking takes, before the stop counts as late


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The command's options."""
    parser.add_argument("--config", type=Path, required=True, help="the robot's YAML file")


def run(options: argparse.Namespace) -> int:
    """Do it; 1 when a step failed."""
    on_ending(interrupt)
    hat = load_yaml(RobotConfig, options.config).hat
    return try_motors(hat, real_motors(hat), Prompts(), MonotonicClock())


def try_motors(
    hat: HatConfig, motors: ContextManager[CountedMotors], person: Prompts, clock: Clock
) -> int:
    """The test with any motors; 0 when all steps passed, 1 when one failed."""
    with motors as opened:
        outcomes = run_selftest(Roller(opened, hat, clock), person)
    for outcome in outcomes:
        person.tell(f"{'OK  ' if outcome.passed else 'FAIL'}  {outcome.name}")
    return int(not all(outcome.passed for outcome in outcomes))


class Outcome(NamedTuple):
    """One step of the test; ``remedy`` says what to look at when it failed."""

    name: str
    passed: bool
    remedy: str


class _Motion(NamedTuple):
    name: str
    turns: Tuple[float, float]  # of the left and of the right wheel
    question: str


_FORWARD, _BACK = "turn once, FORWARD, evenly?", "turn once, BACKWARD, evenly?"
MOTIONS = (
    _Motion("left forward", (1.0, 0.0), f"Did the LEFT wheel alone {_FORWARD}"),
    _Motion("left backward", (-1.0, 0.0), f"Did the LEFT wheel alone {_BACK}"),
    _Motion("right forward", (0.0, 1.0), f"Did the RIGHT wheel alone {_FORWARD}"),
    _Motion("right backward", (0.0, -1.0), f"Did the RIGHT wheel alone {_BACK}"),
    _Motion("both forward", (2.0, 2.0), "Did BOTH wheels turn twice, forward, at one speed?"),
    _Motion("both apart", (-1.0, 1.0), "Did the left wheel turn BACKWARD and the right FORWARD?"),
)
MOTION_REMEDY = (
    "the other wheel moved: exchange hat.left.port and hat.right.port; the wrong way: flip that "
    "motor's `reversed`; it trembled: a terminal holds wires of both windings; more or less than a "
    "turn: mend hat.steps_per_rev (docs/wiring.md)"
)
STOP_REMEDY = "lower hat.acceleration_mps2 and hat.start_stop_mps; look for a loose wheel"
HOLD_REMEDY = "raise hat.hold_duty; check the motor supply"
FREE_REMEDY = "switch the motor supply off at once; the HAT does not obey (docs/wiring.md)"


def run_selftest(roller: Roller, person: Prompts) -> List[Outcome]:
    """Every step, in order; after a failed one the person decides whether to go on.

    ConfigError: the wheels are on the floor, or the input ended. HardwareError: the motors failed.
    """
    if not person.agrees("Do both wheels hang free, with nothing near them?"):
        raise ConfigError("expected wheels off the floor; put the robot on a box first")
    steps: List[Callable[[], Outcome]] = [
        *(_motion_step(roller, person, motion) for motion in MOTIONS),
        lambda: _stop(roller, person),
        lambda: _hold(person),
        lambda: _coils_off(roller, person),
    ]
    outcomes: List[Outcome] = []
    for step in steps:
        outcome = step()
        outcomes.append(outcome)
        if not outcome.passed:
            person.tell(f"FAIL  {outcome.name}: {outcome.remedy}")
            if step is not steps[-1] and not person.agrees("Go on with the next step?"):
                break
    roller.motors.release()
    return outcomes


def _motion_step(roller: Roller, person: Prompts, motion: _Motion) -> Callable[[], Outcome]:
    def step() -> Outcome:
        person.tell(f"--- {motion.name}")
        turn_m = 2.0 * math.pi * roller.config.drive.wheel_radius_m
        left, right = motion.turns
        while True:
            roller.roll(left * turn_m, right * turn_m, GENTLE_MPS)
            if person.agrees(motion.question):
                return Outcome(motion.name, True, "")
            if not person.agrees("Show it again?"):
                return Outcome(motion.name, False, MOTION_REMEDY)

    return step


def _stop(roller: Roller, person: Prompts) -> Outcome:
    """From the fastest speed to rest, as after a fault; the steps say how far."""
    person.tell("--- stop: both wheels run fast, then stop at once")
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
    seen = person.agrees("Did both wheels stop at once, without a knock?")
    return Outcome("stop", seen and rolled <= most_m, STOP_REMEDY)


def _hold(person: Prompts) -> Outcome:
    person.tell("--- hold: the coils hold the wheels now")
    held = person.agrees("Do both wheels RESIST when you turn them gently by hand?")
    return Outcome("hold", held, HOLD_REMEDY)


def _coils_off(roller: Roller, person: Prompts) -> Outcome:
    roller.motors.release()
    roller.clock.sleep(0.5)
    person.tell("--- coils off")
    free = person.agrees("Do both wheels turn FREELY by hand now?")
    return Outcome("coils off", free, FREE_REMEDY)
