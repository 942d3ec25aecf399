"""What lies in a recording: topics, their JSON schemas, and the messages on them.

Pictures, poses and log lines follow Foxglove's well-known schemas, so that its panels show them
(https://docs.foxglove.dev/docs/visualization/message-schemas).
"""

import base64
import dataclasses
import math
import typing
from dataclasses import dataclass
from typing import Any, Dict, NamedTuple, Optional, Tuple, Union

import numpy as np

from robot.geometry import Pose, WheelSpeeds
from robot.link.messages import PoseMessage, Telemetry
from robot.parts import Tick
from robot.safety.governors import Cap
from robot.safety.wheel_limits import Drive
from robot.typed_config import to_plain

NS = 10**9
WHEELS_FRAME = "odometry"  # where the wheels say the robot is, from wherever it began

Json = Dict[str, Any]
Numbers = Tuple[float, ...]


@dataclass(frozen=True)
class Driven:
    """What the wheels were asked for (left, right) [m/s] and what limits it; see ``Drive``."""

    wanted: Tuple[float, float]
    before: Tuple[float, float]
    dt_s: float


@dataclass(frozen=True)
class Turn:
    """One turn, to the last bit of its numbers. Times are of the robot's monotonic clock.

    Ages are None where an input never came or is not used.
    """

    number: int
    time_s: float
    duration_s: float
    lag_s: float
    state: str
    reason: str
    sentence: str
    wheels: Tuple[float, float]  # as sent to the motors (left, right) [m/s]
    frame: Optional[int] = None  # number of the frame it saw
    frame_time_s: Optional[float] = None
    path: Optional[Numbers] = None  # (path_points,) float32, what the policy was told of the way
    commands: Optional[Numbers] = None  # and of its last commands, as `robot.contract.shares`
    values: Optional[Numbers] = None  # (actions,) float32, what it answered
    margin: Optional[float] = None  # of the best value over the second
    action: Optional[int] = None
    driven: Optional[Driven] = None
    most_mps: Optional[float] = None  # that the rules of the road allowed; None: any speed
    governed: Optional[str] = None  # why
    frame_age_s: Optional[float] = None
    pose_age_s: Optional[float] = None
    operator_age_s: Optional[float] = None

    @property
    def drive(self) -> Optional[Drive]:
        """What the wheels were asked for, and what limited it, as the runtime had it."""
        if self.driven is None:
            return None
        cap = Cap() if self.most_mps is None else Cap(self.most_mps, self.governed or "")
        wanted, before = WheelSpeeds(*self.driven.wanted), WheelSpeeds(*self.driven.before)
        return Drive(wanted, before, self.driven.dt_s, cap)

    def plain(self) -> Dict[str, Any]:
        """As JSON has it."""
        return {key: value for key, value in to_plain(self).items() if value is not None}

    @classmethod
    def of(cls, tick: Tick) -> "Turn":
        """What a tick tells."""
        values, inputs, frame, drive = tick.values, tick.inputs, tick.frame, tick.drive
        if values is not None and not np.isfinite(values).all():
            values = None
        path = None if tick.guidance is None else tick.guidance.path
        cap = Cap() if drive is None else drive.cap
        return cls(
            number=tick.number,
            time_s=tick.time_s,
            duration_s=tick.duration_s,
            lag_s=tick.lag_s,
            state=tick.verdict.state.value,
            reason=tick.verdict.reason.value,
            sentence=tick.verdict.sentence,
            wheels=tick.wheels,
            frame=None if frame is None else frame.sequence,
            frame_time_s=None if frame is None else frame.time_s,
            path=None if path is None else tuple(path.tolist()),
            commands=tick.commands or None,
            values=None if values is None else tuple(values.tolist()),
            margin=None if values is None else float(np.diff(np.sort(values)[-2:])[0]),
            action=tick.action,
            driven=None if drive is None else Driven(drive.wanted, drive.before, drive.dt_s),
            most_mps=cap.most_mps if cap.reason else None,
            governed=cap.reason or None,
            frame_age_s=_age(inputs.frame_age_s),
            pose_age_s=_age(inputs.pose_age_s),
            operator_age_s=_age(inputs.link_age_s),
        )


def _age(age_s: Optional[float]) -> Optional[float]:
    return age_s if age_s is not None and math.isfinite(age_s) else None


class Topic(NamedTuple):
    """A channel of a recording and the JSON schema of what it carries."""

    name: str
    schema_name: str
    schema: Json


def _schema(kind: Any) -> Json:
    """The JSON schema of a type that our dataclasses have, or of a dict of types, always full."""
    origin, members = typing.get_origin(kind), typing.get_args(kind)
    if isinstance(kind, dict):
        properties = {name: _schema(each) for name, each in kind.items()}
        return {"type": "object", "properties": properties, "required": list(kind)}
    if dataclasses.is_dataclass(kind):
        hints = typing.get_type_hints(kind)
        properties = {f.name: _schema(hints[f.name]) for f in dataclasses.fields(kind)}
        return {"type": "object", "properties": properties}
    if origin is Union:
        return _schema(next(member for member in members if member is not type(None)))
    if origin is tuple:
        return {"type": "array", "items": _schema(members[0])}
    if kind is bytes:
        return {"type": "string", "contentEncoding": "base64"}
    return {"type": {float: "number", int: "integer", bool: "boolean", str: "string"}[kind]}


_XYZ = dict.fromkeys("xyz", float)
_HEAD = {"timestamp": {"sec": int, "nsec": int}, "frame_id": str}
_PLACE = {**_HEAD, "pose": {"position": _XYZ, "orientation": {**_XYZ, "w": float}}}
_SEEN = {**_PLACE, "heading_known": bool, "confidence": float}

CAMERA = Topic(
    "/camera", "foxglove.CompressedImage", _schema({**_HEAD, "data": bytes, "format": str})
)
POSE = Topic("/pose", "foxglove.PoseInFrame", _schema(_PLACE))
OVERHEAD = Topic("/overhead", "foxglove.PoseInFrame", _schema(_SEEN))
ODOMETRY = Topic("/odometry", "foxglove.PoseInFrame", _schema(_PLACE))
TURN = Topic("/turn", "duckpilot.Turn", _schema(Turn))
TELEMETRY = Topic("/telemetry", "duckpilot.Telemetry", _schema(Telemetry))


def image_message(time_s: float, data: bytes, kind: str) -> Json:
    """A picture as ``png`` or ``jpeg`` bytes."""
    text = base64.b64encode(data).decode("ascii")
    return {"timestamp": _stamp(time_s), "frame_id": "camera", "data": text, "format": kind}


def image_bytes(message: Json) -> bytes:
    """The bytes of ``image_message``."""
    return base64.b64decode(message["data"])


def pose_message(time_s: float, pose: Pose, frame: str = "map") -> Json:
    """A pose on the floor."""
    half_rad = pose.heading_rad / 2.0
    place = {
        "position": {"x": float(pose.x_m), "y": float(pose.y_m), "z": 0.0},
        "orientation": {"x": 0.0, "y": 0.0, "z": math.sin(half_rad), "w": math.cos(half_rad)},
    }
    return {"timestamp": _stamp(time_s), "frame_id": frame, "pose": place}


def overhead_message(time_s: float, seen: PoseMessage) -> Json:
    """What the localizer told; ``heading_known`` where it saw more than a place."""
    pose = Pose(seen.x_m, seen.y_m, seen.heading_rad or 0.0)
    known = seen.heading_rad is not None
    return {**pose_message(time_s, pose), "heading_known": known, "confidence": seen.confidence}


def to_ns(time_s: float) -> int:
    """Seconds since 1970 as the nanoseconds of a recording."""
    return max(0, round(time_s * NS))


def _stamp(time_s: float) -> Json:
    sec, nsec = divmod(to_ns(time_s), NS)
    return {"sec": sec, "nsec": nsec}
