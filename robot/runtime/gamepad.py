"""A gamepad beside the robot, by Linux's joystick interface: no library.

https://www.kernel.org/doc/html/latest/input/joydev/joystick-api.html; axes and buttons as of an
Xbox pad. While LB is held the left stick drives; letting go of it stops.
"""

import errno
import math
import os
import struct
from typing import Dict, Optional

from robot.contract import Stick
from robot.geometry import STILL
from robot.parts import Ask
from robot.safety.state_machine import Command

EVENT = struct.Struct("IhBB")  # time [ms], value, type, number
BUTTON, AXIS, AT_OPENING = 0x01, 0x02, 0x80
MOST_EVENTS = 64  # in one turn of the loop
FULL = 32767.0
DEAD = 0.08  # a stick at rest is seldom at 0
STEER, SPEED = 0, 1  # axes of the left stick: right and back are positive
HELD = 4  # LB
ASKS = {1: Command.STOP, 3: Command.AUTO, 7: Command.ARM}  # B, Y, start


class Gamepad:
    """An ``Operator`` of the runtime. A pad that is gone counts as a silent person."""

    def __init__(self, path: str) -> None:
        self._path = path
        self._fd: Optional[int] = None
        self._axes: Dict[int, float] = {}
        self._held = self._drives = False

    def serve(self, ask: Ask) -> None:
        """Hand over the buttons pressed, and where the stick is while LB is held."""
        data = self._events()
        for at in range(0, len(data), EVENT.size):
            _, value, kind, number = EVENT.unpack_from(data, at)
            self._take(kind, value, number, ask)
        if self._held:
            self._drives = True
            steer, speed = (_beyond_rest(-self._axes.get(axis, 0.0)) for axis in (STEER, SPEED))
            ask(Command.MANUAL, Stick(steer, speed).wheels)
        elif self._drives:
            self._drives = False
            ask(Command.MANUAL, STILL)

    def age_s(self) -> Optional[float]:
        """None while the pad is there: who holds it stands beside the robot."""
        return None if self._fd is not None else math.inf

    def _take(self, kind: int, value: int, number: int, ask: Ask) -> None:
        if kind & ~AT_OPENING == AXIS:
            self._axes[number] = max(-1.0, value / FULL)
        elif number == HELD:  # what the kernel tells anew, after events were lost, never drives
            self._held = value == 1 and (self._held or kind == BUTTON)
        elif value == 1 and number in ASKS and (kind == BUTTON or ASKS[number] is Command.STOP):
            self._held = self._drives = False  # to drive by hand again, press LB again
            ask(ASKS[number], None)

    def _events(self) -> bytes:
        try:
            if self._fd is None:
                self._fd = os.open(self._path, os.O_RDONLY | os.O_NONBLOCK)
            return os.read(self._fd, MOST_EVENTS * EVENT.size)
        except BlockingIOError:
            return b""
        except OSError as error:
            if error.errno not in (errno.ENODEV, errno.ENOENT, errno.ENXIO):
                raise
            if self._fd is not None:
                os.close(self._fd)
            self._fd, self._held, self._axes = None, False, {}
            return b""


def _beyond_rest(value: float) -> float:
    return math.copysign(max(0.0, abs(value) - DEAD) / (1.0 - DEAD), value)
