"""Rolling by counted steps, and the person beside the robot who watches it and answers."""

import math
import sys
from contextlib import suppress
from typing import Tuple

from robot.computer.clock import Clock
from robot.errors import ConfigError, HardwareError
from robot.geometry import STILL, WheelSpeeds
from robot.hat.config import HatConfig
from robot.hat.stepping import Steps
from robot.hat.thread import MotorThread

YES, NO = ("y", "yes"), ("n", "no")
REFRESH_S = 0.05
REST_S = 0.4  # standing so long, it has come to rest
PATIENCE = 3.0  # a roll may take so many times as long as planned, and as many seconds more
CREEP_SHARE = 0.5  # of the start-stop speed: the last steps


class Prompts:
    """The person beside the robot, asked until an answer is one; ConfigError: the input ended."""

    def __init__(self) -> None:
        getattr(sys.stdin, "reconfigure", dict)(errors="replace")  # a wrong byte is no answer

    def tell(self, line: str) -> None:
        """Show a line."""
        print(line, flush=True)

    def agrees(self, question: str) -> bool:
        """A question answered with yes or no."""
        while True:
            answer = self._answer(f"{question} [y/n] ").lower()
            if answer in YES + NO:
                return answer in YES
            self.tell("please type y or n; Ctrl-C stops and switches the motors off")

    def number(self, question: str) -> float:
        """A question answered with a number; a decimal comma is understood."""
        while True:
            answer = self._answer(f"{question} ").replace(",", ".")
            with suppress(ValueError):
                if math.isfinite(float(answer)):
                    return float(answer)
            self.tell("please type a number, such as -2.5; Ctrl-C stops")

    def _answer(self, prompt: str) -> str:
        try:
            return input(prompt).strip()
        except (EOFError, RuntimeError) as error:  # RuntimeError: closed from the beginning
            raise ConfigError("expected a person who answers, got the end of the input") from error


class Roller:
    """Rolls each wheel a given way and stops there, within a step or two.

    The motors are in a ``with`` block of the caller's, so that they are off in the end.
    """

    def __init__(self, motors: MotorThread, config: HatConfig, clock: Clock) -> None:
        self.motors = motors
        self.config = config
        self.clock = clock

    def roll(self, left_m: float, right_m: float, speed_mps: float) -> Tuple[float, float]:
        """How far each went [m]: both arrive together, neither above ``speed_mps``.

        HardwareError: no steps come.
        """
        began = self.motors.counts
        longest_m = max(abs(left_m), abs(right_m))
        lead = 0 if abs(left_m) == longest_m else 1
        give_up_s = self.clock.now() + PATIENCE * (1.0 + longest_m / speed_mps)
        while True:
            done = self._since(began)
            rest_m = longest_m - abs(done[lead])
            if rest_m < self.config.step_m:
                break
            if self.clock.now() > give_up_s:
                raise HardwareError(
                    f"the wheels went {done[0]:.3f} and {done[1]:.3f} m instead of "
                    f"{left_m:.3f} and {right_m:.3f} m; do the motors get their commands?"
                )
            # Fast enough to arrive, slow enough to stop: half of the way is kept for the ramp.
            ramp_mps = math.sqrt(self.config.acceleration_mps2 * rest_m)
            creep_mps = CREEP_SHARE * self.config.start_stop_mps
            share = min(speed_mps, max(creep_mps, ramp_mps)) / longest_m
            self.motors.set_wheels(WheelSpeeds(share * left_m, share * right_m))
            self.clock.sleep(REFRESH_S)
        self.come_to_rest()
        return self._since(began)

    def come_to_rest(self) -> None:
        """Ramp down without losing a step, and wait until both wheels stand."""
        self.motors.set_wheels(STILL)
        last, since_s = self.motors.counts, self.clock.now()
        while self.clock.now() < since_s + REST_S:
            self.clock.sleep(REFRESH_S)
            if self.motors.counts != last:
                last, since_s = self.motors.counts, self.clock.now()

    def _since(self, began: Steps) -> Tuple[float, float]:
        each = zip(self.motors.counts, began, self.config.wheel_steps_m)
        left_m, right_m = ((now - start) * step_m for now, start, step_m in each)
        return left_m, right_m
