"""What is published: poses of the localizer, camera frames of the robot (telemetry: next file).

Every published message carries the ``session`` of its publisher (new at each start), a ``sequence``
that only grows within it, and ``t_sent_s`` of the sender's own monotonic clock; the ``Publisher``
stamps them. A receiver compares such times only with each other, never with its own clock.
The pose follows SSL-Vision's detection frame (t_capture, t_sent, confidence, x, y, orientation).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import ClassVar, Optional, Tuple

from robot.errors import ContractError
from robot.geometry import Pose
from robot.link.wire import COUNT, NAME, TIME_S, Checked, Message, entries, number

FAR_M = 1000.0  # no arena is larger
HALF_TURN_RAD = math.pi + 1e-6
MAX_ROBOTS = 16
UNSENT = "unsent"  # the session of a message that no publisher has stamped


@dataclass(frozen=True)
class Sighting(Checked):
    """One robot in a picture of the overhead camera: world frame [m], [rad].

    ``heading_rad`` is None when only a position was seen.
    """

    robot: str = field(metadata=NAME)
    x_m: float = field(metadata=number(-FAR_M, FAR_M))
    y_m: float = field(metadata=number(-FAR_M, FAR_M))
    heading_rad: Optional[float] = field(metadata=number(-HALF_TURN_RAD, HALF_TURN_RAD))
    confidence: float = field(metadata=number(0.0, 1.0))

    @property
    def pose(self) -> Optional[Pose]:
        """The pose, or None when the heading was not seen."""
        if self.heading_rad is None:
            return None
        return Pose(self.x_m, self.y_m, self.heading_rad)


@dataclass(frozen=True)
class PoseMessage(Sighting):
    """A sighting with its time [s], and with the stamp of the message it came in."""

    t_capture_s: float  # the sender's monotonic clock
    session: str = UNSENT
    sequence: int = 0
    t_sent_s: float = 0.0


@dataclass(frozen=True)
class PosesMessage(Message):
    """All the robots seen in one picture: a stream keeps its newest message, and no robot's pose
    may push out another's.
    """

    robots: Tuple[Sighting, ...] = field(metadata=entries(MAX_ROBOTS))
    t_capture_s: float = field(metadata=TIME_S)  # the sender's monotonic clock
    session: str = field(default=UNSENT, metadata=NAME)
    sequence: int = field(default=0, metadata=COUNT)
    t_sent_s: float = field(default=0.0, metadata=TIME_S)

    KIND: ClassVar[str] = "pose"

    @property
    def every(self) -> Tuple[PoseMessage, ...]:
        """The poses, each with the message's stamp."""
        stamp = (self.t_capture_s, self.session, self.sequence, self.t_sent_s)
        return tuple(
            PoseMessage(r.robot, r.x_m, r.y_m, r.heading_rad, r.confidence, *stamp)
            for r in self.robots
        )

    def of(self, robot: str) -> Optional[PoseMessage]:
        """The pose of this robot; None where it was not seen."""
        return next((pose for pose in self.every if pose.robot == robot), None)


@dataclass(frozen=True)
class FrameMessage(Message):
    """One camera picture as JPEG."""

    jpeg: bytes
    t_capture_s: float = field(metadata=TIME_S)  # the sender's monotonic clock
    session: str = field(default=UNSENT, metadata=NAME)
    sequence: int = field(default=0, metadata=COUNT)
    t_sent_s: float = field(default=0.0, metadata=TIME_S)

    KIND: ClassVar[str] = "frame"
    LIMIT_BYTES: ClassVar[int] = 65536

    def __post_init__(self) -> None:
        super().__post_init__()
        if not (self.jpeg.startswith(b"\xff\xd8") and self.jpeg.endswith(b"\xff\xd9")):
            raise ContractError(f"frame: expected JPEG bytes, got {self.jpeg[:8]!r}…")
