"""What must hold for the robot to move: each input fresh, finite and plausible.

Ages are by the robot's own monotonic clock, from arrival. An age that is NaN or negative (a clock
that jumped) counts as too old.
"""

import math
from dataclasses import dataclass, replace
from enum import Enum
from typing import Iterator, NamedTuple, Optional, Tuple

from robot.contract import MAX_WHEEL_MPS
from robot.errors import ConfigError


class Reason(Enum):
    """Why the robot stands, or why it is in the state it is in."""

    BOOT = "boot"
    PERSON = "person"
    ARRIVED = "arrived"
    # Gates.
    LOOP_LATE = "loop_late"
    FRAME_STALE = "frame_stale"
    FRAME_FROZEN = "frame_frozen"
    PICTURE_BLIND = "picture_blind"
    PICTURE_WRONG = "picture_wrong"
    PICTURE_STILL = "picture_still"
    NON_FINITE = "non_finite"
    DUPLICATE_PUBLISHER = "duplicate_publisher"
    POSE_JUMP = "pose_jump"
    POSE_DOUBT = "pose_doubt"
    NOT_MOVING = "not_moving"
    POSE_STALE = "pose_stale"
    POSE_UNSURE = "pose_unsure"
    OFF_MAP = "off_map"
    OFF_PATH = "off_path"
    NO_MISSION = "no_mission"
    LINK_LOST = "link_lost"
    MANUAL_STALE = "manual_stale"
    # A part that raised an error.
    CAMERA = "camera"
    POLICY = "policy"
    MOTORS = "motors"
    NAVIGATOR = "navigator"
    OPERATOR = "operator"
    SUBSCRIBER = "subscriber"
    RUNTIME = "runtime"


@dataclass(frozen=True)
class SafetyLimits:
    """When an input is too old. The defaults are where comparable products agree.

    ConfigError for what is not positive, or a speed beyond the action table's.
    """

    frame_age_s: float = 0.2
    frozen_frames: int = 5  # new frames with the same bytes while driving; above a camera's delay
    blind_s: float = 0.5  # without a picture that shows anything: a hand before the lens
    still_s: float = 1.3  # of turning wheels before a picture that stands
    loop_age_s: float = 0.2  # ArduPilot Rover disarms when its main loop stalls for 0.2 s
    pose_age_s: float = 1.0
    pose_within_m: float = 0.08  # of where the robot is, 95 % sure; asked of robots with sight
    pose_within_rad: float = 0.35
    link_age_s: float = 1.0
    manual_age_s: float = 0.3  # ros2_control's diff_drive and LeKiwi take 0.5
    max_wheel_mps: float = MAX_WHEEL_MPS

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            if not 0 < value < math.inf:
                raise ConfigError(f"{name}: expected a positive number, got {value}")
        if self.max_wheel_mps > MAX_WHEEL_MPS:
            told = f"fastest wheel of the action table, got {self.max_wheel_mps:g}"
            raise ConfigError(f"max_wheel_mps: expected at most {MAX_WHEEL_MPS:g} m/s, the {told}")


@dataclass(frozen=True)
class Inputs:
    """What the gates look at. An age is infinite until its input has come once."""

    frame_age_s: float
    frame_repeats: int = 0  # new frames in a row, each with the bytes of the one before
    blind_s: float = 0.0  # age of the last picture that showed anything
    still_s: float = 0.0  # since the picture last changed or the wheels stood
    picture_wrong: str = ""  # what is wrong with the pictures, in words; "" is nothing
    values_finite: bool = True  # the policy gave a number for every action
    pose_age_s: Optional[float] = None  # None unless the robot navigates
    pose_within: Optional[Tuple[float, float]] = None  # 95 % sure [m], [rad]; without sight None
    link_age_s: Optional[float] = None  # None when it was started without a link
    manual_age_s: Optional[float] = None  # None until a person has driven by hand
    no_mission: bool = False
    off_path: bool = False
    off_map: bool = False
    pose_jump: bool = False
    pose_doubt: bool = False  # the overhead poses tell another way than the wheels' steps
    not_moving: bool = False  # the wheels step, the overhead poses stay where they are
    duplicate_publisher: bool = False

    def aged(self, by_s: float) -> "Inputs":
        """The same, with pose and operator so much older [s]."""
        pose_s, link_s = self.pose_age_s, self.link_age_s
        return replace(
            self,
            pose_age_s=None if pose_s is None else pose_s + by_s,
            link_age_s=None if link_s is None else link_s + by_s,
        )


class Trip(NamedTuple):
    """A gate that does not hold, in words for a person."""

    reason: Reason
    sentence: str


# A doubt that an input names, by its reason.
_DOUBTS = {
    Reason.DUPLICATE_PUBLISHER: "two localizers send poses of this robot; switch one off",
    Reason.POSE_JUMP: "the overhead pose, or the lane in the pictures, jumped farther than the "
    "robot can drive; was it carried?",
    Reason.NOT_MOVING: "the wheels step, but the overhead poses stand; is the robot held, lifted "
    "or blocked, or the overhead picture frozen?",
    Reason.POSE_DOUBT: "the overhead poses tell another way than the wheels; do they drift, or are "
    "they another robot's?",
    Reason.NO_MISSION: "no destination is set",
    Reason.OFF_MAP: "the robot is off the map",
    Reason.OFF_PATH: "the robot has left its planned path",
}


def trips(inputs: Inputs, loop_age_s: float, limits: SafetyLimits) -> Iterator[Trip]:
    """Every gate that does not hold, the gravest of a kind first.

    ``loop_age_s`` is the time since the gates were last looked at [s].
    """
    operator = "the operator's last sign of life"
    manual_age_s = math.inf if inputs.manual_age_s is None else inputs.manual_age_s
    for reason, what, age_s, limit_s in (
        (Reason.LOOP_LATE, "the control loop", loop_age_s, limits.loop_age_s),
        (Reason.FRAME_STALE, "the camera's newest frame", inputs.frame_age_s, limits.frame_age_s),
        (Reason.POSE_STALE, "the newest overhead pose", inputs.pose_age_s, limits.pose_age_s),
        (Reason.LINK_LOST, operator, inputs.link_age_s, limits.link_age_s),
        (Reason.MANUAL_STALE, "the last manual command", manual_age_s, limits.manual_age_s),
    ):
        if age_s is not None and _old(age_s, limit_s):
            yield Trip(reason, _late(what, age_s, limit_s))
    yield from _picture_trips(inputs, limits)
    if not inputs.values_finite:
        yield Trip(Reason.NON_FINITE, "the policy gave no finite values")
    for reason, sentence in _DOUBTS.items():
        if getattr(inputs, reason.value):
            yield Trip(reason, sentence)
    place_m, turned_rad = inputs.pose_within or (0.0, 0.0)
    if not (place_m <= limits.pose_within_m and turned_rad <= limits.pose_within_rad):  # nor a NaN
        yield Trip(
            Reason.POSE_UNSURE,
            f"the pose is only known to {100.0 * place_m:.0f} cm and "
            f"{math.degrees(turned_rad):.0f} degrees, not to {100.0 * limits.pose_within_m:g} cm "
            f"and {math.degrees(limits.pose_within_rad):.0f} degrees",
        )


def _picture_trips(inputs: Inputs, limits: SafetyLimits) -> Iterator[Trip]:
    if inputs.frame_repeats >= limits.frozen_frames:
        times = inputs.frame_repeats + 1
        sentence = f"the camera sent the same picture {times} times while driving"
        yield Trip(Reason.FRAME_FROZEN, sentence)
    if _old(inputs.blind_s, limits.blind_s):
        sentence = _late("the last picture that shows anything", inputs.blind_s, limits.blind_s)
        yield Trip(Reason.PICTURE_BLIND, f"{sentence}; is the lens covered?")
    if inputs.picture_wrong:
        yield Trip(Reason.PICTURE_WRONG, inputs.picture_wrong)
    if _old(inputs.still_s, limits.still_s):
        sentence = f"the wheels turn, but for {inputs.still_s:.1f} s the picture has not moved"
        yield Trip(Reason.PICTURE_STILL, f"{sentence}; is the robot held, or the picture?")


def _old(age_s: float, limit_s: float) -> bool:
    return not 0.0 <= age_s <= limit_s


def _late(what: str, age_s: float, limit_s: float) -> str:
    if age_s == math.inf:
        return f"{what} has not come yet"
    if not age_s >= 0.0:
        return f"{what} is dated in the future ({age_s:g} s): the clock jumped"
    return f"{what} is {1e3 * age_s:.0f} ms old, more than {1e3 * limit_s:.0f} ms"
