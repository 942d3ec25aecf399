"""The robot's ear: commands of monitors, each done once, old ones refused, one hand at a time."""

import math
import time
from collections import OrderedDict
from typing import Callable, List, Optional, Tuple

from robot.errors import ContractError, DuckpilotError
from robot.link.messages import ALWAYS_TAKEN, MAX_ECHO_AGE_S, REASON_LIMIT_BYTES, Ack, Command
from robot.link.sockets import Clock, Link, new_session, receive_now
from robot.link.wire import tidy_text

MAX_SERVED = 32  # commands in one call, so that a flood cannot hold up the control loop
REMEMBERED = 256
CLOCK_ROUNDING_S = 1e-3
HELD_S = 1.0  # a holder who is silent for longer no longer keeps others from it
# By then the robot has stopped for want of its holder, and whoever else is there may arm it.
FORGOTTEN_S = 2.0
MOVES = ("arm", "auto", "mission", "manual")
RELEASES = ("stop", "disarm")

Sender = Tuple[str, str]  # name of its key, its session
Handler = Callable[[Command], None]  # raises DuckpilotError to refuse, with the reason


class OperatorLock:
    """Who may make the robot move, when several operators are connected; for one thread.

    Whoever armed it has it, for as long as they are heard. Others may watch, and may always stop
    it; after that it is free. Times [s] are of the robot's clock.
    """

    def __init__(self) -> None:
        self._holder: Optional[Sender] = None
        self._echo_s = -math.inf  # the newest time that anybody has shown to know
        self._holder_echo_s = -math.inf

    def heard(self, sender: Sender, echo_s: float) -> None:
        """``sender`` has shown to know what the robot said at ``echo_s``."""
        self._echo_s = max(self._echo_s, echo_s)
        if sender == self._holder:
            self._holder_echo_s = max(self._holder_echo_s, echo_s)

    def problem(self, sender: Sender, kind: str, now_s: float) -> str:
        """Why ``sender`` may not command this; "" when it may."""
        held = self._holder is not None and now_s - self._holder_echo_s <= HELD_S
        if kind not in (*MOVES, "place") or sender == self._holder or not held:
            return ""
        return "another operator has armed the robot; to take over, stop it, then arm it yourself"

    def done(self, sender: Sender, kind: str, echo_s: float) -> None:
        """A command of ``sender``, who knew what the robot said at ``echo_s``, was done."""
        if kind in MOVES:
            self._holder, self._holder_echo_s = sender, echo_s
        elif kind in RELEASES:
            self._holder = None

    def age_s(self, now_s: float) -> float:
        """How long nobody was heard who counts: the holder, or anybody where there is none."""
        if self._holder is not None and now_s - self._holder_echo_s <= FORGOTTEN_S:
            return now_s - self._holder_echo_s
        return now_s - self._echo_s


class CommandServer:
    """The robot's side. ``serve`` in every turn of the control loop; it never blocks."""

    def __init__(self, link: Link, clock: Clock = time.monotonic) -> None:
        self.session = new_session()
        self.refused = 0
        self.last_refusal = ""
        self._link = link
        self._clock = clock
        self._answers: OrderedDict[Tuple[Sender, str], Ack] = OrderedDict()
        self._lock = OperatorLock()
        self._socket = link.bind(Command.KIND, Command.LIMIT_BYTES)

    def serve(self, handle: Handler) -> None:
        """Read what has come, give each new command to ``handle`` once, and answer all."""
        import zmq

        self._link.allow_list.admit()
        for _ in range(MAX_SERVED):
            parts = receive_now(self._socket, copy=False)
            if parts is None:
                return
            ack = self._answer(parts, handle)
            if ack is not None:
                self._socket.send_multipart([parts[0].bytes, ack.to_bytes()], zmq.NOBLOCK)

    def operator_age_s(self) -> float:
        """How old [s] the newest word from the robot is that its operator has shown to know.

        Infinite when nobody did. Counted from the echo and not from the arrival, so that beats held
        up on the way do not look alive. While somebody has the robot, others do not count.
        """
        return self._lock.age_s(self._clock())

    def _answer(self, parts: List, handle: Handler) -> Optional[Ack]:
        try:
            if len(parts) != 2:
                raise ContractError(f"command: expected one part, got {len(parts) - 1}")
            user = parts[1].get("User-Id")  # the name of the sender's key
            if not self._link.allow_list.may(user, Command.KIND):
                raise ContractError(f"command: expected a monitor's key, got the key of {user}")
            command = Command.from_bytes(parts[1].bytes)
        except ContractError as error:
            self.refused += 1
            self.last_refusal = str(error)
            return None
        sender = (user, command.session)
        if command.robot_session == self.session:
            self._lock.heard(sender, min(command.robot_time_s, self._clock()))
        return self._answers.get((sender, command.id)) or self._do(command, handle, sender)

    def _do(self, command: Command, handle: Handler, sender: Sender) -> Ack:
        reason = self._staleness(command)
        reason = reason or self._lock.problem(sender, command.kind, self._clock())
        if not reason and command.kind != "beat":
            try:
                handle(command)
                self._lock.done(sender, command.kind, min(command.robot_time_s, self._clock()))
            except DuckpilotError as error:
                reason = tidy_text(str(error), REASON_LIMIT_BYTES) or "refused"
        ack = Ack(command.id, not reason, reason, self.session, self._clock())
        if command.kind != "beat":
            self._answers[sender, ack.id] = ack
            while len(self._answers) > REMEMBERED:
                self._answers.popitem(last=False)
        return ack

    def _staleness(self, command: Command) -> str:
        if command.kind in ALWAYS_TAKEN:
            return ""
        if command.robot_session != self.session:
            return "the robot was started since its sender last heard it; send the command again"
        age_s = self._clock() - command.robot_time_s
        if not -CLOCK_ROUNDING_S <= age_s <= MAX_ECHO_AGE_S:
            return f"the command is {age_s:.1f} s old; send it again"
        return ""
