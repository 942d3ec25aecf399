"""One wheel's speed over time: linear ramps above the start-stop speed, jumps below it.

A stepper follows a sudden change of speed only below its start-stop speed; above it the speed must
change gradually (Acarnley, Stepping Motors, 4th ed., chapters 5 and 6). Positions are in steps,
solved in closed form from the last change of target, so that no error gathers with time.
"""

from __future__ import annotations

import math
from typing import List, NamedTuple, Optional, Tuple


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
    """The motion of one wheel, from standing still at position 0 at ``time_s``.

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
        return self._piece_at(time_s).at(time_s)

    def retarget(self, time_s: float, target: float, acceleration: float = 0.0) -> None:
        """From ``time_s`` on, change to ``target`` [steps/s] as fast as the motor can follow.

        A brake may be harder than that: at ``acceleration`` [steps/s^2].
        """
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

    def _piece_at(self, time_s: float) -> _Piece:
        for piece in self._pieces:
            if time_s < piece.start_s + piece.duration_s:
                return piece
        return self._pieces[-1]

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
        floor = min(abs(target), slow)
        start = speed if abs(speed) > slow else math.copysign(floor, target)
        end = target if abs(target) > slow else math.copysign(min(abs(start), slow), target)
        ramp(start, end)
        append(math.inf, target, 0.0)
        self.target, self._pieces = target, pieces


def _sign(value: float) -> int:
    return (value > 0.0) - (value < 0.0)
