"""The operator's hand: sends commands, collects the answers, repeats STOP until it is acked."""

import math
import secrets
import time
from contextlib import suppress
from typing import Dict, List, Optional, Tuple

from robot.errors import ContractError
from robot.geometry import WheelSpeeds
from robot.link.messages import UNSENT, Ack, Command, Mission
from robot.link.sockets import DEAF_S, Clock, Link, new_session, receive_now

BEAT_S = 0.1
STOP_REPEAT_S = 0.1
ANSWER_WITHIN_S = 1.0


class CommandClient:
    """The operator's side. ``poll`` often: it beats, repeats STOP and collects the answers."""

    def __init__(self, link: Link, clock: Clock = time.monotonic) -> None:
        self.session = new_session()
        self._link = link
        self._clock = clock
        self._connected_s = clock()
        self._echo = UNSENT, 0.0  # the robot's session, and its time [s] when it last answered
        self._heard_s = -math.inf
        self._beat_s = -math.inf
        self._pending: Dict[str, Tuple[Command, float]] = {}  # unanswered, and when it was sent
        self._socket = link.connect(Command.KIND, Command.LIMIT_BYTES)

    def send(
        self, kind: str, mission: Optional[Mission] = None, wheels: Optional[WheelSpeeds] = None
    ) -> str:
        """Send a command once (STOP: until it is acked); ``poll`` gives the answer to this id."""
        for pending, _ in self._pending.values():
            if kind == pending.kind == "stop":
                return pending.id
        command = Command(secrets.token_hex(8), self.session, kind, mission, wheels, *self._echo)
        self._transmit(command)
        if kind != "beat":
            self._pending[command.id] = (command, self._clock())
        return command.id

    def poll(self, beat: bool = True) -> Tuple[Ack, ...]:
        """The answers that came; a command without one in ``ANSWER_WITHIN_S`` counts as refused.

        Without ``beat`` the robot learns within its link limit that its operator is gone.
        """
        now_s = self._clock()
        acks = self._collect(now_s)
        if now_s - max(self._heard_s, self._connected_s) > DEAF_S:
            self._connected_s = now_s
            self._link.reconnect(self._socket, Command.KIND)
        if beat and now_s - self._beat_s >= BEAT_S:
            self._beat_s = now_s
            self.send("beat")
        for command, sent_s in list(self._pending.values()):
            if command.kind == "stop" and now_s - sent_s >= STOP_REPEAT_S:
                self._pending[command.id] = (command, now_s)
                self._transmit(command)
            if command.kind != "stop" and now_s - sent_s >= ANSWER_WITHIN_S:
                del self._pending[command.id]
                acks.append(Ack(command.id, False, "the robot does not answer"))
        return tuple(acks)

    def silence_s(self) -> float:
        """Time [s] since the robot last answered anything; infinite when it never did."""
        return self._clock() - self._heard_s

    def _collect(self, now_s: float) -> List[Ack]:
        acks: List[Ack] = []
        while True:
            parts = receive_now(self._socket)
            if parts is None:
                return acks
            try:
                ack = Ack.from_bytes(parts[-1])
            except ContractError:
                continue
            self._heard_s = now_s
            self._echo = ack.robot_session, ack.robot_time_s
            if self._pending.pop(ack.id, None) is not None:
                acks.append(ack)

    def _transmit(self, command: Command) -> None:
        import zmq

        with suppress(zmq.Again):  # nobody is connected: poll reports that, and repeats a STOP
            self._socket.send(command.to_bytes(), zmq.NOBLOCK)
