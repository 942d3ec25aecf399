"""What a person asks of the robot, and its answer.

A command that moves the robot must echo the robot's own clock as the sender last heard it: one that
waited in a network buffer is then recognised as old and refused, without a shared clock. Stopping
is always taken.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Optional, Tuple

from robot.errors import ContractError
from robot.link.messages import FAR_M, MAX_TIME_S, UNSENT
from robot.link.wire import (
    Message,
    require_name,
    require_number,
    require_one_of,
    require_text,
)

ALWAYS_TAKEN = ("beat", "stop", "disarm")
WITH_MISSION = ("plan", "mission", "place")
KINDS = (*ALWAYS_TAKEN, "arm", "clear", *WITH_MISSION, "manual")
MAX_ECHO_AGE_S = 0.7  # an arm, clear, mission or manual command older than this is refused
REASON_LIMIT_BYTES = 400
FAST_MPS = 1.0  # the robot's own limits are below


@dataclass(frozen=True)
class Mission:
    """Drive to ``destination`` [m], world frame.

    With ``start`` only when the robot is there: whoever says it has put the robot there.
    """

    destination: Tuple[float, float]
    start: Optional[Tuple[float, float]] = None

    def __post_init__(self) -> None:
        for what, point in (("start", self.start), ("destination", self.destination)):
            for value in point or ():
                require_number(f"mission {what} [m]", value, -FAR_M, FAR_M)


@dataclass(frozen=True)
class Command(Message):
    """One request. Kinds:

    ``beat`` says that the operator is there; ``stop`` is the emergency stop; ``disarm`` lets the
    coils go; ``clear`` acknowledges a fault; ``arm`` makes ready; ``plan`` asks whether the robot
    would take ``mission``, and changes nothing; ``mission`` drives it; ``place`` says that the
    robot stands at the start of ``mission`` and looks towards its destination; ``manual`` turns the
    ``wheels`` (left, right) [m/s] (None: stand) for the robot's ``SafetyLimits.manual_age_s``.
    """

    id: str
    session: str  # of the sender
    kind: str
    mission: Optional[Mission] = None
    wheels: Optional[Tuple[float, float]] = None
    robot_session: str = UNSENT  # echo of the robot's newest ack
    robot_time_s: float = 0.0

    KIND: ClassVar[str] = "command"

    def __post_init__(self) -> None:
        require_name("command id", self.id)
        require_name("command session", self.session)
        require_one_of("command kind", self.kind, KINDS)
        for speed in self.wheels or ():
            require_number("command wheels [m/s]", speed, -FAST_MPS, FAST_MPS)
        require_name("command robot_session", self.robot_session)
        require_number("command robot_time_s", self.robot_time_s, 0.0, MAX_TIME_S)
        if (self.mission is not None) != (self.kind in WITH_MISSION):
            raise ContractError(
                f"command {self.kind}: expected a mission with kind plan, mission or place, and "
                "with no other"
            )
        if self.kind == "place" and (self.mission is None or self.mission.start is None):
            raise ContractError("command place: expected the start of a mission, where it stands")
        if self.wheels is not None and self.kind != "manual":
            raise ContractError(f"command {self.kind}: expected wheels only with kind manual")


@dataclass(frozen=True)
class Ack(Message):
    """The robot's answer to the command ``id``; its clock is what the next command echoes."""

    id: str
    accepted: bool
    reason: str = ""  # why not
    robot_session: str = UNSENT
    robot_time_s: float = 0.0

    KIND: ClassVar[str] = "ack"

    def __post_init__(self) -> None:
        require_name("ack id", self.id)
        require_text("ack reason", self.reason, REASON_LIMIT_BYTES)
        require_name("ack robot_session", self.robot_session)
        require_number("ack robot_time_s", self.robot_time_s, 0.0, MAX_TIME_S)
