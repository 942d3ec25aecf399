"""Test the motors step by step, with the wheels off the floor; a person watches and answers.

Ctrl-C ends it at any moment: the wheels brake and the coils go off. Exit status 1 when a step
failed.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import ContextManager

from robot.bringup.prompts import Prompts
from robot.bringup.roller import CountedMotors, Roller
from robot.bringup.selftest import run_selftest
from robot.computer.clock import Clock, MonotonicClock
from robot.computer.systemd import interrupt, on_ending
from robot.config import RobotConfig
from robot.hat.config import HatConfig
from robot.hat.thread import real_motors
from robot.typed_config import load_yaml


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
