"""What the robot says about itself, ten times a second: enough for the whole monitor page."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import ClassVar, Optional, Tuple

import numpy as np

from robot.contract import FIVE_ACTIONS, MOST_ACTIONS, ActionTable
from robot.link.messages import FAR_M, HALF_TURN_RAD, UNSENT
from robot.link.wire import COUNT, NAME, TIME_S, Checked, Message, entries, number, one_of, text

STATES = ("DISARMED", "READY", "AUTO", "MANUAL", "HOLD", "FAULT")
PHASES = ("driving", "arrived", "failed", "stopped")
SOURCES = ("overhead", "sight", "wheels")
LEVELS = ("ok", "warn", "bad")
TEXT_LIMIT_BYTES = 160
MAX_PATH_POINTS, MAX_ENTRIES = 96, 8
BEND_WORTH_M = 0.4  # a radian of bend is drawn with as many points as this length of straight

XY = Tuple[float, float]
LABEL, TEXT, TITLE = text(24), text(TEXT_LIMIT_BYTES), text(64)
PLACE_M, AGE_S, SIZE = number(-FAR_M, FAR_M), number(0.0, 1e6), number(-1e9, 1e9)
RIM_MPS = number(-100.0, 100.0)  # no robot's wheel is faster


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
    wheels: Optional[Tuple[float, float]] = field(default=None, metadata=RIM_MPS)
    fps: float = field(default=0.0, metadata=number(0.0, 1e4))  # decisions a second
    lag_s: float = field(default=0.0, metadata=AGE_S)  # from capture to wheels
    model: str = field(default="", metadata=TITLE)
    map: str = field(default="", metadata=TITLE)
    belief: Optional[Belief] = None  # of a robot with sight
    # Of the policy: left and right rim speed [m/s].
    actions: ActionTable = field(
        default=FIVE_ACTIONS, metadata={**RIM_MPS, **entries(MOST_ACTIONS)}
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
    """Points (M, 2) [m] of a path, thinned to what telemetry carries, rounded to 1 mm.

    Both ends stay; bends keep more points than straights.
    """
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
    return max(0.0, age_s) if math.isfinite(age_s) else None
