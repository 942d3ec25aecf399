"""``python -m tools.practise``: the robot's self-test on virtual motors, to learn it beforehand.

The same code as ``python -m robot selftest``, in real time; as nobody can see virtual wheels, what
they did is told before each question.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Callable

import numpy as np

from robot.bringup.prompts import Prompts
from robot.cli.selftest import try_motors
from robot.command_line import OneLineParser, answer
from robot.hat.clock import MonotonicClock
from robot.hat.config import HatConfig, MotorConfig
from robot.hat.driver import MotorDriver
from robot.hat.stepper_hat import StepperHat
from robot.hat.thread import MotorThread
from sim_pybullet.virtual.hat import VirtualHat
from sim_pybullet.virtual.i2c import VirtualI2cBus

# Robots to find the fault of; the virtual motors themselves are always the same.
ROBOTS = {
    "well": HatConfig(),
    "left-reversed": HatConfig(left=MotorConfig("M1M2", reversed=True)),
    "plugs-exchanged": HatConfig(
        left=MotorConfig("M3M4", reversed=True), right=MotorConfig("M1M2")
    ),
}


class SightedPerson(Prompts):
    """A person who is told what the virtual wheels did."""

    def __init__(self, hat: VirtualHat, read: Callable[[str], str] = input) -> None:
        super().__init__(read)
        self._hat = hat
        self._seen_rad = hat.wheel_angles_rad

    def agrees(self, question: str) -> bool:
        """Tell, then ask."""
        now_rad = self._hat.wheel_angles_rad
        left, right = np.round((now_rad - self._seen_rad) / (2.0 * math.pi), 2) + 0.0
        self._seen_rad = now_rad
        coils = "on" if self._hat.chip.outputs.any_high else "off"
        self.tell(f"    (you see: left {left:+g} turns, right {right:+g} turns, coils {coils})")
        return super().agrees(question)


def practise(config: HatConfig, read: Callable[[str], str] = input) -> int:
    """The self-test of one robot; 0 when all steps passed, 1 when one failed."""
    clock, bus = MonotonicClock(), VirtualI2cBus()
    hat = VirtualHat(bus, clock)
    motors = MotorThread(MotorDriver(StepperHat(bus, config, clock), config, clock))
    return try_motors(config, motors, SightedPerson(hat, read), clock)


def main(arguments: list[str] | None = None) -> int:
    """Exit status 0 when all steps passed, 1 when one failed, 2 for wrong input."""
    parser = OneLineParser(prog="python -m tools.practise", description=__doc__)
    parser.add_argument(
        "--robot", choices=sorted(ROBOTS), default="well", help="which fault it has"
    )
    options = parser.parse_args(arguments)
    return answer("practise", lambda: practise(ROBOTS[options.robot]))


if __name__ == "__main__":
    sys.exit(main())
