"""What lies in a recording: topics, their JSON schemas, and the messages on them.

Pictures, poses and log lines follow Foxglove's well-known schemas, so that its panels show them
(https://docs.foxglove.dev/docs/visualization/message-schemas).
"""

from __future__ import annotations

import base64
import dataclasses
import math
import typing
from typing import Any, Dict, NamedTuple, Union

from robot.geometry import Pose
from robot.link.messages import PoseMessage
from robot.link.telemetry import Telemetry
from robot.recording.turn import Turn

NS = 10**9
WHEELS_FRAME = "odometry"  # where the wheels say the robot is, from wherever it began

Json = Dict[str, Any]


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
