"""From wheel speeds to the moments of single steps. Pure: time is an argument.

A stepper follows a sudden change of speed only below its start-stop speed; above it the speed must
change gradually (Acarnley, Stepping Motors, 4th ed., chapters 5 and 6). Positions are in steps,
solved in closed form from the last change of target, so that no error gathers with time.
"""

import math
from typing import List, NamedTuple, Optional, Tuple

from robot.geometry import Pose, WheelSpeeds
from robot.hat.config import HatConfig

LAG_MAX_FULL_STEPS = 0.5  # a rotor within half a step of the field still has most of its torque
BRAKE_S = 0.15  # from full speed to rest; what is left of a slip still brakes
STALL_FULL_STEPS = 1.0  # a field that stood this much too long has stopped the rotor


class Crossing(NamedTuple):
    """When the motion reaches the next whole step, in which direction (+1, -1), in which piece."""

    time_s: float
    direction: int
    piece: int


class _Piece(NamedTuple):
    """Motion at constant acceleration from ``start_s`` for ``duration_s``."""

    start_s: float
    duration_s: float
    position: float
    speed: float
    acceleration: float

    @property
    def direction(self) -> int:
        """+1, -1, or 0 for standing still; a piece never turns round."""
        return _sign(self.speed) or _sign(self.acceleration)

    def at(self, time_s: float) -> Tuple[float, float]:
        """Position and speed at a time, clipped to the piece."""
        t = min(max(time_s - self.start_s, 0.0), self.duration_s)
        position = self.position + (self.speed + 0.5 * self.acceleration * t) * t
        return position, self.speed + self.acceleration * t

    def reaches(self, position: float) -> Optional[float]:
        """When the piece, which never turns round, passes ``position``; None if it does not."""
        distance = position - self.position
        if distance == 0.0:
            return self.start_s
        root = self.speed * self.speed + 2.0 * self.acceleration * distance
        if root < 0.0:
            return None
        end_speed = math.copysign(math.sqrt(root), distance)
        if self.speed + end_speed == 0.0:
            return None
        # Not (end_speed - speed) / acceleration, which loses all digits when that is small.
        t = 2.0 * distance / (self.speed + end_speed)
        return self.start_s + t if 0.0 <= t <= self.duration_s else None


class WheelRamp:
    """The motion of one wheel, from standing still at position 0 at ``time_s``: linear ramps.

    It can start at, or stop from, ``start_stop`` [steps/s] without a ramp, and follow
    ``acceleration`` [steps/s^2] above that.
    """

    def __init__(self, start_stop: float, acceleration: float, time_s: float) -> None:
        self.target = 0.0  # [steps/s]
        self._start_stop, self._acceleration = start_stop, acceleration
        self._pieces = [_Piece(time_s, math.inf, 0.0, 0.0, 0.0)]
        self._direction = 0  # of the last motion
        self._reverse_from_s = -math.inf  # when the rotor has come to rest enough to turn back

    def at(self, time_s: float) -> Tuple[float, float]:
        """Position [steps] and speed [steps/s] at a time not before the last change."""
        pieces = (p for p in self._pieces if time_s < p.start_s + p.duration_s)
        return next(pieces, self._pieces[-1]).at(time_s)

    def retarget(self, time_s: float, target: float, acceleration: float = 0.0) -> None:
        """From ``time_s`` on, to ``target`` [steps/s] by ramps, or by a harder ``acceleration``."""
        position, speed = self.at(time_s)
        self._note_rest(time_s)
        self._plan(time_s, position, speed, target, acceleration)

    def stand(self, time_s: float, position: float) -> None:
        """The rotor stands still at ``position``, whatever was planned."""
        self._note_rest(time_s)
        self._plan(time_s, position, 0.0, 0.0)

    def restart(self, time_s: float, position: float) -> None:
        """The rotor has stood still at ``position``: go on from there at a speed it can start."""
        _, speed = self.at(time_s)
        start = math.copysign(min(abs(speed), self._start_stop), speed)
        self._plan(time_s, position, start, self.target)

    def delay(self, shift_s: float) -> None:
        """Do everything that is still to come ``shift_s`` later."""
        self._pieces = [p._replace(start_s=p.start_s + shift_s) for p in self._pieces]

    def next_crossing(self, step: int) -> Optional[Crossing]:
        """When the motion next reaches ``step`` + 1 or ``step`` - 1; None while it never does.

        ``step`` must be the last one reached: pieces of the motion before it are forgotten.
        """
        for index, piece in enumerate(self._pieces):
            direction = piece.direction
            if direction == 0:
                continue
            beyond = (piece.position - (step + direction)) * direction
            time_s = piece.start_s if beyond >= 0.0 else piece.reaches(step + direction)
            if time_s is not None:
                return Crossing(time_s, direction, index)
        return None

    def pass_crossing(self, crossing: Crossing) -> None:
        """The step was made: what the wheel did before it must not be found again."""
        self._note_rest(self._pieces[crossing.piece].start_s)
        del self._pieces[: crossing.piece]

    def _note_rest(self, time_s: float) -> None:
        """Remember when and in which direction the wheel last moved, up to ``time_s``."""
        for piece in self._pieces:
            if piece.start_s < time_s and piece.direction:
                end_s = min(piece.start_s + piece.duration_s, time_s)
                self._direction = piece.direction
                self._reverse_from_s = end_s + 1.0 / self._start_stop

    def _plan(
        self, time_s: float, position: float, speed: float, target: float, acceleration: float = 0.0
    ) -> None:
        pieces: List[_Piece] = []

        def append(duration_s: float, start_speed: float, acceleration: float) -> None:
            nonlocal time_s, position
            piece = _Piece(time_s, duration_s, position, start_speed, acceleration)
            pieces.append(piece)
            if duration_s < math.inf:
                time_s += duration_s
                position, _ = piece.at(time_s)

        def ramp(from_speed: float, to_speed: float) -> None:
            if from_speed != to_speed:
                duration_s = abs(to_speed - from_speed) / (acceleration or self._acceleration)
                append(duration_s, from_speed, (to_speed - from_speed) / duration_s)

        slow = self._start_stop
        same_way = target != 0.0 and _sign(target) == _sign(speed)
        if not same_way:
            ramp(speed, math.copysign(min(abs(speed), slow), speed))
            came_from = _sign(speed) or self._direction
            if target != 0.0 and came_from == -_sign(target):
                rest_s = 1.0 / slow if speed else max(0.0, self._reverse_from_s - time_s)
                append(rest_s, 0.0, 0.0)
            speed = 0.0
        start = speed if abs(speed) > slow else math.copysign(min(abs(target), slow), target)
        end = target if abs(target) > slow else math.copysign(min(abs(start), slow), target)
        ramp(start, end)
        append(math.inf, target, 0.0)
        self.target, self._pieces = target, pieces


def _sign(value: float) -> int:
    return (value > 0.0) - (value < 0.0)


class Steps(NamedTuple):
    """Microsteps of the two wheels, forward positive."""

    left: int
    right: int


def pose_after(pose: Pose, steps: Steps, config: HatConfig) -> Pose:
    """Where a robot is whose wheels made these steps at the same time: an exact arc."""
    left_m, right_m = (n * step_m for n, step_m in zip(steps, config.wheel_steps_m))
    return pose.moved(0.5 * (left_m + right_m), (right_m - left_m) / config.drive.baseline_m)


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
