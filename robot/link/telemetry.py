"""What the robot says about itself, ten times a second: enough for the whole monitor page."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar, Optional, Tuple

import numpy as np

from robot.contract import FIVE_ACTIONS, MOST_ACTIONS, ActionTable
from robot.errors import ContractError
from robot.link.messages import FAR_M, UNSENT, require_stamp
from robot.link.wire import (
    Message,
    require_length,
    require_name,
    require_number,
    require_one_of,
    require_text,
)

STATES = ("DISARMED", "READY", "AUTO", "MANUAL", "HOLD", "FAULT")
PHASES = ("driving", "arrived", "failed", "stopped")
SOURCES = ("overhead", "sight", "wheels")
LEVELS = ("ok", "warn", "bad")
TEXT_LIMIT_BYTES = 160
MAX_PATH_POINTS = 96
MAX_ENTRIES = 8
MAX_AGE_S = 1e6
BEND_WORTH_M = 0.4  # a radian of bend is drawn with as many points as this length of straight
BIG = 1e9
FAST_MPS = 100.0  # no robot's wheel is faster

XY = Tuple[float, float]


@dataclass(frozen=True)
class InputAge:
    """How old the newest of one input is; None when none ever came."""

    name: str  # camera, pose, monitor, ...
    age_s: Optional[float]
    limit_s: float  # older than this and the robot stops

    def __post_init__(self) -> None:
        require_text("input name", self.name, 24)
        require_number("input age_s", self.age_s, 0.0, MAX_AGE_S)
        require_number("input limit_s", self.limit_s, 0.0, MAX_AGE_S)


@dataclass(frozen=True)
class Reading:
    """One health figure, judged by the robot: a temperature, free disk, bus errors."""

    name: str
    value: float
    unit: str = ""
    level: str = "ok"  # one of LEVELS

    def __post_init__(self) -> None:
        require_text("reading name", self.name, 24)
        require_number("reading value", self.value, -BIG, BIG)
        require_text("reading unit", self.unit, 8)
        require_one_of("reading level", self.level, LEVELS)


@dataclass(frozen=True)
class MissionStatus:
    """How the mission stands: progress 0 to 1, what is left [m], offset from the path [m]."""

    id: str
    destination: XY  # world frame [m]
    phase: str = "driving"  # one of PHASES
    progress: float = 0.0
    remaining_m: float = 0.0
    offset_m: float = 0.0  # left of the path is positive
    reason: str = ""

    def __post_init__(self) -> None:
        require_name("mission id", self.id)
        _require_xy("mission destination", self.destination)
        require_one_of("mission phase", self.phase, PHASES)
        require_number("mission progress", self.progress, 0.0, 1.0)
        require_number("mission remaining_m", self.remaining_m, 0.0, BIG)
        require_number("mission offset_m", self.offset_m, -FAR_M, FAR_M)
        require_text("mission reason", self.reason, TEXT_LIMIT_BYTES)


@dataclass(frozen=True)
class Belief:
    """An ellipse that holds the robot with 95 %, its heading likewise, and what tells them."""

    long_m: float  # half axes
    short_m: float
    along_rad: float  # direction of the longer, in the world
    turned_rad: float
    source: str  # one of SOURCES

    def __post_init__(self) -> None:
        for what, value in vars(self).items():
            if what != "source":
                require_number(f"belief {what}", value, -FAR_M, FAR_M)
        require_one_of("belief source", self.source, SOURCES)


@dataclass(frozen=True)
class Telemetry(Message):
    """The robot's report. ``pose`` is the fused estimate: x [m], y [m], heading [rad]."""

    robot: str
    state: str  # one of STATES
    reason: str = ""
    action: Optional[int] = None  # one of ``actions``; None when standing
    values: Tuple[float, ...] = ()  # the policy's output, one an action
    pose: Optional[Tuple[float, float, float]] = None
    path: Tuple[XY, ...] = ()  # the planned way, world frame [m]; see ``thin_path``
    mission: Optional[MissionStatus] = None
    inputs: Tuple[InputAge, ...] = ()
    health: Tuple[Reading, ...] = ()
    wheels: Optional[Tuple[float, float]] = None  # as told to the motors (left, right) [m/s]
    fps: float = 0.0  # decisions a second
    lag_s: float = 0.0  # from capture to wheels
    model: str = ""
    map: str = ""
    belief: Optional[Belief] = None  # of a robot with sight
    actions: ActionTable = FIVE_ACTIONS  # of the policy: left and right rim speed [m/s]
    session: str = UNSENT
    sequence: int = 0
    t_sent_s: float = 0.0

    KIND: ClassVar[str] = "telemetry"

    def __post_init__(self) -> None:
        require_name("telemetry robot", self.robot)
        require_one_of("telemetry state", self.state, STATES)
        require_text("telemetry reason", self.reason, TEXT_LIMIT_BYTES)
        require_text("telemetry model", self.model, 64)
        require_text("telemetry map", self.map, 64)
        require_number("telemetry action", self.action, 0, len(self.actions) - 1)
        require_length("telemetry values", self.values, MOST_ACTIONS)
        for value in self.values:
            require_number("telemetry values", value, -BIG, BIG)
        require_length("telemetry actions", self.actions, MOST_ACTIONS)
        for speed in (speed for wheels in self.actions for speed in wheels):
            require_number("telemetry actions", speed, -FAST_MPS, FAST_MPS)
        if self.pose is not None:
            _require_xy("telemetry pose", self.pose[:2])
            require_number("telemetry heading", self.pose[2], -math.pi - 1e-6, math.pi + 1e-6)
        require_length("telemetry path", self.path, MAX_PATH_POINTS)
        for point in self.path:
            _require_xy("telemetry path", point)
        require_length("telemetry inputs", self.inputs, MAX_ENTRIES)
        require_length("telemetry health", self.health, MAX_ENTRIES)
        for speed in self.wheels or ():
            require_number("telemetry wheels", speed, -FAST_MPS, FAST_MPS)
        require_number("telemetry fps", self.fps, 0.0, 1e4)
        require_number("telemetry lag_s", self.lag_s, 0.0, MAX_AGE_S)
        require_stamp(self.session, self.sequence, self.t_sent_s)


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


def _require_xy(what: str, point: Tuple[float, ...]) -> None:
    if len(point) != 2:
        raise ContractError(f"{what}: expected x and y, got {len(point)} numbers")
    for value in point:
        require_number(what, value, -FAR_M, FAR_M)
