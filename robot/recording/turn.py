"""``Turn``: one turn of the loop as it is recorded, with all that decided it."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Dict, Optional, Tuple

import numpy as np

from robot.geometry import WheelSpeeds
from robot.parts import Tick
from robot.safety.governors import Cap
from robot.safety.wheel_limits import Drive
from robot.typed_config import to_plain

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
    def of(cls, tick: Tick) -> Turn:
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
