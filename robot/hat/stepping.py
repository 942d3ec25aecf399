"""From wheel speeds to the moments of single steps, for both wheels. Pure: time is an argument."""

from __future__ import annotations

from typing import NamedTuple, Optional

from robot.geometry import Pose, WheelSpeeds
from robot.hat.config import HatConfig
from robot.hat.ramp import WheelRamp

LAG_MAX_FULL_STEPS = 0.5  # a rotor within half a step of the field still has most of its torque
BRAKE_S = 0.15  # from full speed to rest; what is left of a slip still brakes
STALL_FULL_STEPS = 1.0  # a field that stood this much too long has stopped the rotor


class Steps(NamedTuple):
    """Microsteps of the two wheels, forward positive."""

    left: int
    right: int


def pose_after(pose: Pose, steps: Steps, config: HatConfig) -> Pose:
    """Where a robot is whose wheels made these steps at the same time: an exact arc."""
    left_m, right_m = (n * step_m for n, step_m in zip(steps, config.wheel_steps_m))
    turn_rad = (right_m - left_m) / config.drive.baseline_m
    return pose.moved(0.5 * (left_m + right_m), turn_rad)


class StepPlanner:
    """Plans the steps of both wheels from standing still at ``time_s``.

    Deadlines come in closed form from the last change of speed, so a steady speed has no drift. A
    caller who is late makes the motion wait, not hurry: a rotor that is hurried loses steps.
    """

    def __init__(self, config: HatConfig, time_s: float) -> None:
        self._config = config
        limits = (config.start_stop_mps / config.step_m, config.acceleration_mps2 / config.step_m)
        self._wheels = (WheelRamp(*limits, time_s), WheelRamp(*limits, time_s))
        self.counts = Steps(0, 0)  # all so far
        self.stalls = 0  # times that the caller was so late that a wheel had to start again

    @property
    def deadline_s(self) -> Optional[float]:
        """When the next step of either wheel is due; None while both stand."""
        crossings = [w.next_crossing(n) for w, n in zip(self._wheels, self.counts)]
        return min((c.time_s for c in crossings if c is not None), default=None)

    def set_speeds(self, time_s: float, speeds: WheelSpeeds) -> None:
        """Aim for these speeds [m/s] from ``time_s`` on; the same speeds again change nothing."""
        for wheel, speed_mps, step_m in zip(self._wheels, speeds, self._config.wheel_steps_m):
            target = speed_mps / step_m
            if target != wheel.target:
                wheel.retarget(time_s, target)

    def brake(self, time_s: float) -> None:
        """Stop as in an emergency: harder than the ramps, but not so hard that rotors slip far."""
        deceleration = self._config.max_speed_mps / BRAKE_S / self._config.step_m
        for wheel in self._wheels:
            wheel.retarget(time_s, 0.0, deceleration)

    def freeze(self, time_s: float) -> None:
        """No further step, without a ramp: a fast wheel may slip past its last position."""
        for wheel in self._wheels:
            wheel.stand(time_s, wheel.at(time_s)[0])

    def stand(self, time_s: float) -> None:
        """Nobody asked for so long that the wheels stand: what was due by now is forgotten."""
        self.stalls += 1
        for wheel, count in zip(self._wheels, self.counts):
            wheel.stand(time_s, count)

    def speeds(self, time_s: float) -> WheelSpeeds:
        """The speeds that the ramps have reached [m/s]."""
        steps_m = self._config.wheel_steps_m
        left, right = (w.at(time_s)[1] * step_m for w, step_m in zip(self._wheels, steps_m))
        return WheelSpeeds(left, right)

    def advance(self, time_s: float) -> Steps:
        """The steps due at ``time_s``, at most one per wheel; ask again until none is due."""
        due = [self._step_due(*each, time_s) for each in zip(self._wheels, self.counts)]
        self.counts = Steps(*(count + step for count, step in zip(self.counts, due)))
        return Steps(*due)

    def _step_due(self, wheel: WheelRamp, count: int, time_s: float) -> int:
        crossing = wheel.next_crossing(count)
        if crossing is None or crossing.time_s > time_s:
            return 0
        speed = abs(wheel.at(time_s)[1]) / self._config.microsteps  # [full steps/s]
        late_s = time_s - crossing.time_s
        wheel.pass_crossing(crossing)
        if late_s * speed > STALL_FULL_STEPS:
            wheel.restart(time_s, count + crossing.direction)
            self.stalls += 1
        elif late_s * speed > LAG_MAX_FULL_STEPS:
            for each in self._wheels:  # both wait, so that the robot keeps to its path
                each.delay(late_s - LAG_MAX_FULL_STEPS / speed)
        return crossing.direction
