"""What a person asks of the robot, and its answer.

A command that moves the robot must echo the robot's own clock as the sender last heard it: one that
waited in a network buffer is then recognised as old and refused, without a shared clock. Stopping
is always taken.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import ClassVar, Optional, Tuple

from robot.errors import ContractError
from robot.link.messages import FAR_M, UNSENT
from robot.link.wire import NAME, TIME_S, Checked, Message, number, one_of, text

ALWAYS_TAKEN = ("beat", "stop", "disarm")
WITH_MISSION = ("plan", "mission", "place")
KINDS = (*ALWAYS_TAKEN, "arm", "clear", "auto", *WITH_MISSION, "manual")
MAX_ECHO_AGE_S = 0.7  # any other command that is older than this is refused
REASON_LIMIT_BYTES = 400
RIM_MPS = number(-1.0, 1.0)  # the robot's own limits are below


@dataclass(frozen=True)
class Mission(Checked):
    """Drive to ``destination`` [m], world frame.

    With ``start`` only when the robot is there: whoever says it has put the robot there.
    """

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
