"""Published streams: a publisher that stamps, a subscriber that gives the newest valid message."""

from __future__ import annotations

import secrets
import time
from dataclasses import replace
from typing import Callable, Generic, Optional, Type, TypeVar, Union

from robot.errors import ContractError
from robot.link.messages import FRAME_LIMIT_BYTES, FrameMessage, PosesMessage
from robot.link.sockets import DEAF_S, Link
from robot.link.telemetry import Telemetry
from robot.link.wire import MESSAGE_LIMIT_BYTES

Clock = Callable[[], float]
M = TypeVar("M", PosesMessage, FrameMessage, Telemetry)


def limit_bytes(kind: Union[Type[PosesMessage], Type[FrameMessage], Type[Telemetry]]) -> int:
    """The largest message [bytes] of a stream of this class."""
    return FRAME_LIMIT_BYTES if kind is FrameMessage else MESSAGE_LIMIT_BYTES


def new_session() -> str:
    """A name for one run of a publisher or of the robot: 16 random hexadecimal digits."""
    return secrets.token_hex(8)


class Publisher(Generic[M]):
    """Publishes one stream at ``endpoint``; ``send`` never blocks."""

    def __init__(
        self, link: Link, endpoint: str, kind: Type[M], clock: Clock = time.monotonic
    ) -> None:
        import zmq

        self.session = new_session()
        self._link = link
        self._clock = clock
        self._sequence = 0
        self._socket = link.bind(zmq.PUB, endpoint, limit_bytes(kind), kind.KIND)

    def send(self, message: M) -> M:
        """Stamp the message with session, sequence and time, and publish it.

        Returns:
            The message as sent.
        """
        self._link.admit()
        self._sequence += 1
        stamped = replace(
            message, session=self.session, sequence=self._sequence, t_sent_s=self._clock()
        )
        self._socket.send(stamped.to_bytes())
        return stamped


class Subscriber(Generic[M]):
    """The newest message of the stream of a class, published at ``endpoint``.

    ``refused`` counts what was no message of this class, ``last_refusal`` says what was wrong.
    Order, age and plausibility are judged by ``freshness``.
    """

    def __init__(
        self,
        link: Link,
        endpoint: str,
        kind: Type[M],
        clock: Clock = time.monotonic,
    ) -> None:
        import zmq

        self.refused = 0
        self.last_refusal = ""
        self._link = link
        self._endpoint = endpoint
        self._clock = clock
        self._alive_s = clock()  # last heard or connected
        self._kind: Type[M] = kind
        self._socket = link.connect(
            zmq.SUB, endpoint, limit_bytes(kind), kind.KIND, newest_only=True
        )

    def receive(self) -> Optional[M]:
        """The newest message since the last call, or None; never blocks."""
        import zmq

        try:
            data = self._socket.recv(zmq.NOBLOCK)
        except zmq.Again:
            self._reconnect_if_deaf()
            return None
        self._alive_s = self._clock()
        try:
            return self._kind.from_bytes(data)
        except ContractError as error:
            self.refused += 1
            self.last_refusal = str(error)
            return None

    def _reconnect_if_deaf(self) -> None:
        if self._clock() - self._alive_s > DEAF_S:
            self._alive_s = self._clock()
            self._link.reconnect(self._socket, self._endpoint)
