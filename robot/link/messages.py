"""What is published, poses, camera frames and telemetry, and what a person asks of the robot.

Every published message carries the ``session`` of its publisher (new at each start), a ``sequence``
that only grows within it, and ``t_sent_s`` of the sender's own monotonic clock; the ``Publisher``
stamps them. A command echoes the robot's clock, as the sender last heard it (docs/links.md).
The pose follows SSL-Vision's detection frame (t_capture, t_sent, confidence, x, y, orientation).
"""

import math
from dataclasses import dataclass, field
from typing import ClassVar, Optional, Tuple

import numpy as np

from robot.contract import FIVE_ACTIONS, MOST_ACTIONS, ActionTable
from robot.errors import ContractError
from robot.link.wire import COUNT, NAME, TIME_S, Checked, Message, entries, number, one_of, text

FAR_M = 1000.0  # no arena is larger
HALF_TURN_RAD = math.pi + 1e-6
MAX_ROBOTS = 16
UNSENT = "unsent"  # the session of a message that no publisher has stamped
ALWAYS_TAKEN = ("beat", "stop", "disarm")
WITH_MISSION = ("plan", "mission", "place")
KINDS = (*ALWAYS_TAKEN, "arm", "clear", "auto", *WITH_MISSION, "manual")
MAX_ECHO_AGE_S = 0.7  # any other command that is older than this is refused
REASON_LIMIT_BYTES = 400
RIM_MPS = number(-1.0, 1.0)  # the robot's own limits are below
STATES = ("DISARMED", "READY", "AUTO", "MANUAL", "HOLD", "FAULT")
PHASES = ("driving", "arrived", "failed", "stopped")
SOURCES = ("overhead", "sight", "wheels")
LEVELS = ("ok", "warn", "bad")
TEXT_BYTES = 160
MAX_PATH_POINTS, MAX_ENTRIES = 96, 8
BEND_WORTH_M = 0.4  # a radian of bend is drawn with as many points as this length of straight
XY = Tuple[float, float]
LABEL, TEXT, TITLE = text(24), text(TEXT_BYTES), text(64)
LONGEST_S = 1e6  # ages beyond, of 12 days, are told as this
PLACE_M, AGE_S, SIZE = number(-FAR_M, FAR_M), number(0.0, LONGEST_S), number(-1e9, 1e9)
WHEEL_MPS = number(-100.0, 100.0)  # no robot's wheel is faster


@dataclass(frozen=True)
class Sighting(Checked):
    """One robot in an overhead picture: world frame [m], [rad]; perhaps without a heading."""

    robot: str = field(metadata=NAME)
    x_m: float = field(metadata=number(-FAR_M, FAR_M))
    y_m: float = field(metadata=number(-FAR_M, FAR_M))
    heading_rad: Optional[float] = field(metadata=number(-HALF_TURN_RAD, HALF_TURN_RAD))
    confidence: float = field(metadata=number(0.0, 1.0))


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
        stamp = {key: value for key, value in vars(self).items() if key != "robots"}
        return tuple(PoseMessage(**vars(robot), **stamp) for robot in self.robots)

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


@dataclass(frozen=True)
class Mission(Checked):
    """Drive to ``destination`` [m], world frame; who tells ``start`` has put the robot there."""

    destination: Tuple[float, float] = field(metadata=number(-FAR_M, FAR_M))
    start: Optional[Tuple[float, float]] = field(default=None, metadata=number(-FAR_M, FAR_M))


@dataclass(frozen=True)
class Command(Message):
    """One request. Kinds:

    ``beat`` says that the operator is there; ``stop`` is the emergency stop; ``disarm`` lets the
    coils go; ``clear`` acknowledges a fault; ``arm`` makes ready; ``auto`` lets a robot drive that
    keeps its lane; ``plan`` asks whether the robot would take ``mission``, and changes nothing;
    ``mission`` drives it; ``place`` says that the robot stands at the start of ``mission`` and
    looks towards its destination; ``manual`` turns the ``wheels`` (left, right) [m/s] (None: stand)
    for the robot's ``SafetyLimits.manual_age_s``.
    """

    id: str = field(metadata=NAME)
    session: str = field(metadata=NAME)  # of the sender
    kind: str = field(metadata=one_of(KINDS))
    mission: Optional[Mission] = None
    wheels: Optional[Tuple[float, float]] = field(default=None, metadata=RIM_MPS)
    robot_session: str = field(default=UNSENT, metadata=NAME)  # echo of the robot's newest ack
    robot_time_s: float = field(default=0.0, metadata=TIME_S)

    KIND: ClassVar[str] = "command"

    def __post_init__(self) -> None:
        super().__post_init__()
        if (self.mission is not None) != (self.kind in WITH_MISSION):
            raise ContractError(f"command {self.kind}: expected a mission with {WITH_MISSION} only")
        if self.kind == "place" and (self.mission is None or self.mission.start is None):
            raise ContractError("command place: expected the start of a mission, where it stands")
        if self.wheels is not None and self.kind != "manual":
            raise ContractError(f"command {self.kind}: expected wheels only with kind manual")


@dataclass(frozen=True)
class Ack(Message):
    """The robot's answer to the command ``id``; its clock is what the next command echoes."""

    id: str = field(metadata=NAME)
    accepted: bool
    reason: str = field(default="", metadata=text(REASON_LIMIT_BYTES))  # why not
    robot_session: str = field(default=UNSENT, metadata=NAME)
    robot_time_s: float = field(default=0.0, metadata=TIME_S)

    KIND: ClassVar[str] = "ack"


@dataclass(frozen=True)
class InputAge(Checked):
    """How old the newest of one input is; None when none ever came."""

    name: str = field(metadata=LABEL)  # camera, pose, monitor, ...
    age_s: Optional[float] = field(metadata=AGE_S)
    limit_s: float = field(metadata=AGE_S)  # older than this and the robot stops


@dataclass(frozen=True)
class Reading(Checked):
    """One health figure, judged by the robot: a temperature, free disk, bus errors."""

    name: str = field(metadata=LABEL)
    value: float = field(metadata=SIZE)
    unit: str = field(default="", metadata=text(8))
    level: str = field(default="ok", metadata=one_of(LEVELS))


@dataclass(frozen=True)
class MissionStatus(Checked):
    """How the mission stands: progress 0 to 1, what is left [m], offset from the path [m]."""

    id: str = field(metadata=NAME)
    destination: XY = field(metadata=PLACE_M)  # world frame [m]
    phase: str = field(default="driving", metadata=one_of(PHASES))
    progress: float = field(default=0.0, metadata=number(0.0, 1.0))
    remaining_m: float = field(default=0.0, metadata=number(0.0, 1e9))
    offset_m: float = field(default=0.0, metadata=PLACE_M)  # left of the path is positive
    reason: str = field(default="", metadata=TEXT)


@dataclass(frozen=True)
class Belief(Checked):
    """An ellipse that holds the robot with 95 %, its heading likewise, and what tells them."""

    long_m: float = field(metadata=PLACE_M)  # half axes
    short_m: float = field(metadata=PLACE_M)
    along_rad: float = field(metadata=PLACE_M)  # direction of the longer, in the world
    turned_rad: float = field(metadata=PLACE_M)
    source: str = field(metadata=one_of(SOURCES))


@dataclass(frozen=True)
class Telemetry(Message):
    """The robot's report. ``pose`` is the fused estimate: x [m], y [m], heading [rad]."""

    robot: str = field(metadata=NAME)
    state: str = field(metadata=one_of(STATES))
    reason: str = field(default="", metadata=TEXT)
    action: Optional[int] = None  # one of ``actions``; None when standing
    values: Tuple[float, ...] = field(default=(), metadata={**SIZE, **entries(MOST_ACTIONS)})
    pose: Optional[Tuple[float, float, float]] = field(default=None, metadata=PLACE_M)
    # The planned way, world frame [m]; see ``thin_path``.
    path: Tuple[XY, ...] = field(default=(), metadata={**PLACE_M, **entries(MAX_PATH_POINTS)})
    mission: Optional[MissionStatus] = None
    inputs: Tuple[InputAge, ...] = field(default=(), metadata=entries(MAX_ENTRIES))
    health: Tuple[Reading, ...] = field(default=(), metadata=entries(MAX_ENTRIES))
    # As told to the motors (left, right) [m/s].
    wheels: Optional[Tuple[float, float]] = field(default=None, metadata=WHEEL_MPS)
    fps: float = field(default=0.0, metadata=number(0.0, 1e4))  # decisions a second
    lag_s: float = field(default=0.0, metadata=AGE_S)  # from capture to wheels
    model: str = field(default="", metadata=TITLE)
    map: str = field(default="", metadata=TITLE)
    belief: Optional[Belief] = None  # of a robot with sight
    # Of the policy: left and right rim speed [m/s].
    actions: ActionTable = field(
        default=FIVE_ACTIONS, metadata={**WHEEL_MPS, **entries(MOST_ACTIONS)}
    )
    session: str = field(default=UNSENT, metadata=NAME)
    sequence: int = field(default=0, metadata=COUNT)
    t_sent_s: float = field(default=0.0, metadata=TIME_S)

    KIND: ClassVar[str] = "telemetry"

    def __post_init__(self) -> None:
        super().__post_init__()
        number(0, len(self.actions) - 1)["number"]("Telemetry.action", self.action)
        if self.pose is not None:
            number(-HALF_TURN_RAD, HALF_TURN_RAD)["number"]("Telemetry.pose", self.pose[2])


def thin_path(points_m: np.ndarray) -> Tuple[XY, ...]:
    """A path (M, 2) [m], thinned (in bends least) to what telemetry carries, rounded to 1 mm."""
    points = np.asarray(points_m, dtype=float)
    if len(points) > MAX_PATH_POINTS:
        steps = np.diff(points, axis=0)
        headings = np.unwrap(np.arctan2(steps[:, 1], steps[:, 0]))
        turns = np.abs(np.diff(headings, prepend=headings[:1]))
        worth = np.hypot(steps[:, 0], steps[:, 1]) + BEND_WORTH_M * turns
        along = np.concatenate(([0.0], np.cumsum(worth)))
        wanted = np.linspace(0.0, along[-1], MAX_PATH_POINTS)
        points = points[np.unique(np.searchsorted(along, wanted - 1e-9))]
    return tuple((round(float(x), 3), round(float(y), 3)) for x, y in points)


def told_age(age_s: float) -> Optional[float]:
    """An age [s] as a message takes it: None for what never came."""
    return min(max(0.0, age_s), LONGEST_S) if math.isfinite(age_s) else None
