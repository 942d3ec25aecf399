"""A robot of virtual motors on a bench, and a person who sees what its wheels truly do."""

from __future__ import annotations

import math
from types import TracebackType
from typing import Callable, List, Optional, Tuple, Type

import numpy as np

from robot.geometry import Pose, WheelSpeeds
from robot.hat.config import HatConfig
from robot.hat.stepping import Steps
from sim_pybullet.virtual.rotor import RotorModel
from tests.robot.hat.rig import make_rig


class BenchMotors:
    """Virtual motors in lock-step, as a ``MotorThread`` in a ``with`` block, and their clock.

    Args:
        config: what the robot believes.
        steps_per_rev: of the true motors.
    """

    def __init__(self, config: HatConfig, steps_per_rev: float = 48.0) -> None:
        self.rig = make_rig(config, RotorModel(steps_per_rev=steps_per_rev))
        self.dead = False

    def __enter__(self) -> BenchMotors:
        self.rig.driver.open()
        return self

    def __exit__(
        self,
        kind: Optional[Type[BaseException]],
        error: Optional[BaseException],
        trace: Optional[TracebackType],
    ) -> None:
        self.rig.driver.close()

    def set_wheels(self, wheels: WheelSpeeds) -> None:
        if not self.dead:
            self.rig.driver.set_wheels(wheels)

    def stop(self) -> None:
        self.rig.driver.stop()

    def release(self) -> None:
        self.rig.driver.release()

    @property
    def counts(self) -> Steps:
        return self.rig.driver.planner.counts

    def now(self) -> float:
        return self.rig.clock.now()

    def sleep(self, duration_s: float) -> None:
        self.rig.wait(duration_s)

    @property
    def angles_rad(self) -> np.ndarray:
        """How far each wheel has turned forward by now."""
        return self.rig.hat.wheel_angles_rad

    @property
    def coils_on(self) -> bool:
        return self.rig.hat.chip.outputs.any_high


class Spectator:
    """Answers by what the wheels did since the last question.

    Args:
        motors: to watch.
        radii_m: true radii of the wheels.
        baseline_m: true distance of the wheels.
    """

    def __init__(
        self,
        motors: BenchMotors,
        radii_m: Tuple[float, float] = (0.0325, 0.0325),
        baseline_m: float = 0.102,
    ) -> None:
        self.motors, self.radii_m, self.baseline_m = motors, radii_m, baseline_m
        self.told: List[str] = []
        self.asked: List[str] = []
        self.interrupt: Optional[Callable[[str], None]] = None
        self._seen_rad = motors.angles_rad

    def tell(self, line: str) -> None:
        self.told.append(line)

    def agrees(self, question: str) -> bool:
        self._hear(question)
        if question.startswith(("Do both wheels hang free", "Is the robot", "Does the robot")):
            return True
        if question.startswith(("Go on", "Show it again")):
            return False
        coils = self.motors.coils_on
        for words, answer in (("RESIST", coils), ("FREELY", not coils), ("stop at once", True)):
            if words in question:
                return answer
        expected = np.array(self._expected(question)) * 2.0 * math.pi
        return bool(np.abs(self._turned() - expected).max() < 0.15)

    def number(self, question: str) -> float:
        self._hear(question)
        turned = self._turned(keep="AHEAD" in question)
        left_m, right_m = turned * self.radii_m
        turn_rad = (right_m - left_m) / self.baseline_m
        end = Pose(0.0, 0.0, 0.0).moved(0.5 * (left_m + right_m), turn_rad)
        if "AHEAD" in question:
            return round(100.0 * end.x_m, 1)
        if "LEFT" in question:
            return round(100.0 * end.y_m, 1)
        assert "DEGREES" in question
        return round(math.degrees(math.remainder(turn_rad, 2.0 * math.pi)))

    def _hear(self, question: str) -> None:
        self.asked.append(question)
        if self.interrupt is not None:
            self.interrupt(question)

    def _turned(self, keep: bool = False) -> np.ndarray:
        now = self.motors.angles_rad
        turned = now - self._seen_rad
        if not keep:
            self._seen_rad = now
        return turned

    @staticmethod
    def _expected(question: str) -> Tuple[float, float]:
        if "BOTH" in question:
            return (2.0, 2.0)
        if "left wheel turn BACKWARD and" in question:
            return (-1.0, 1.0)
        sign = 1.0 if "FORWARD" in question else -1.0
        assert "LEFT" in question or "RIGHT" in question
        return (sign, 0.0) if "LEFT" in question else (0.0, sign)
